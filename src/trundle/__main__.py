"""`python -m trundle` is `trundle`."""

from __future__ import annotations

import sys

from trundle.apps.cli import main

__all__: list[str] = []

if __name__ == "__main__":
    sys.exit(main())
