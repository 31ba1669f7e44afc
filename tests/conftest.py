"""What every test may use: the recordings beside the checkout, and hypothesis without a stopwatch."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

try:
    from hypothesis import HealthCheck, settings
except ImportError:  # an environment of its own may do without
    pass
else:
    # Tests time nothing: the machine may be busy. CI draws the same examples every time.
    settings.register_profile(
        "house",
        deadline=None,
        derandomize=bool(os.environ.get("CI")),
        suppress_health_check=[HealthCheck.too_slow],
    )
    settings.load_profile("house")

CHECKOUT = Path(__file__).resolve().parents[1]
RECORDINGS = CHECKOUT.parent / "shared" / "data"


@pytest.fixture(scope="session")
def checkout() -> Path:
    """The root of the working tree."""
    return CHECKOUT


@pytest.fixture(scope="session")
def shared_data() -> Path:
    """The folder of real recordings, which is not part of the repository; skips by name without it."""
    if not RECORDINGS.is_dir():
        pytest.skip("the recordings of ../shared/data are not on this machine")
    return RECORDINGS
