"""Our differential drive and donkeycar's own `Unicycle`, on the same wheel distances."""

from __future__ import annotations

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from trundle.odometry import WheelOdometry
from trundle.robot import Differential

with pytest.MonkeyPatch.context() as patch:
    patch.setattr("builtins.print", lambda *_, **__: None)  # donkeycar greets whoever imports it
    kinematics = pytest.importorskip(
        "donkeycar.parts.kinematics", reason="donkeycar lives in .envs/donkeycar"
    )

steps = st.lists(st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)), min_size=1, max_size=30)


@given(steps=steps, axle_length=st.floats(0.02, 2.0))
def test_midpoint_odometry_is_donkeycars(steps, axle_length):
    radius = 0.04
    theirs = kinematics.Unicycle(axle_length)
    ours = WheelOdometry(Differential(track_width=axle_length, wheel_radius=radius), integrator="midpoint")
    left = right = 0.0
    theirs.run(left, right, 1.0)
    state = ours.update(1.0, (0.0, 0.0))
    for count, (dl, dr) in enumerate(steps):
        left, right, time = left + dl, right + dr, 1.1 + 0.1 * count
        _, _, x, y, angle, *_ = theirs.run(left, right, time)
        state = ours.update(time, (left / radius, right / radius))
    assert state.accepted
    assert math.isclose(state.pose.x, x, abs_tol=1e-12)
    assert math.isclose(state.pose.y, y, abs_tol=1e-12)
    assert math.isclose(math.remainder(state.pose.theta - angle, math.tau), 0.0, abs_tol=1e-11)
