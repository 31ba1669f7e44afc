"""Where the robot really was, as a log's tracking system says it."""

from __future__ import annotations

import numpy as np
import numpy.typing as npt

from trundle.errors import ConfigError, LogSchema
from trundle.geometry import se2
from trundle.records import Trajectory
from trundle.robot.log_mapping import Kind, ReferenceMapping, Unit

__all__ = ["TRACKED_POINT", "jumps", "reference_trajectory"]

Floats = npt.NDArray[np.float64]

TRACKED_POINT = "tracked_point"

# No robot moves faster than this.
FASTEST = 15.0  # m/s
FASTEST_TURN = 30.0  # rad/s
LONG_TURN = 10.0  # rad/s: or turns faster for long
USUAL = 0.5  # m/s: of several units the likeliest makes it this
FEW = 3  # seconds that are too short a run to judge units by


def reference_trajectory(
    source: object,
    time_ns: npt.NDArray[np.int64],
    x: Floats,
    y: Floats,
    theta: Floats | None,
    mapping: ReferenceMapping,
) -> Trajectory:
    """The recorded poses, in SI units, of the robot's base where that can be known.

    With a heading, a pose of the tracked point becomes one of the base: `base = tracked @ mounting^-1`.
    Without one that cannot be done: the positions stay those of the tracked point, and `child_frame` is
    `tracked_point` where that is another point. Whoever compares moves the estimate there:
    `estimate @ mounting`. Samples without a position are left out.

    Args:
        source: The file, for errors.
        time_ns: Stamps [ns], shape (N,).
        x: In the mapping's unit, shape (N,).
        y: In the mapping's unit, shape (N,).
        theta: In the mapping's angle unit, shape (N,); None where it was not measured.
        mapping: Units and mounting.

    Raises:
        ConfigError: If they are steps, and have no heading or one is not finite: they could not be joined.
        LogSchema: `unit`, if no robot moves or turns like that.
    """
    heading = np.full(len(time_ns), np.nan) if theta is None else theta * mapping.angle_unit.factor
    poses = np.stack([x * mapping.unit.factor, y * mapping.unit.factor, heading], axis=-1)
    if mapping.kind is Kind.INCREMENT:
        unknown = np.flatnonzero(~np.isfinite(poses).all(axis=1))
        if len(unknown):
            problem = f"increment, but step {unknown[0]} is {poses[unknown[0]].tolist()}, must be finite"
            raise ConfigError("log.reference.kind", problem)
        poses = _joined(poses)
    _check_units(source, time_ns, poses, mapping)
    mounted = mapping.mounting != (0.0, 0.0, 0.0)
    if mounted and theta is not None:
        poses = se2.compose(poses, se2.inverse(np.array(mapping.mounting)))
    measured = np.isfinite(poses[:, :2]).all(axis=1)
    elsewhere = theta is None and mapping.mounting[:2] != (0.0, 0.0)
    return Trajectory(
        time_ns=time_ns[measured],
        poses=poses[measured],
        frame="map",
        child_frame=TRACKED_POINT if elsewhere else "base_link",
    )


def _check_units(
    source: object, time_ns: npt.NDArray[np.int64], poses: Floats, mapping: ReferenceMapping
) -> None:
    """Refuse what most of the time moves or turns as no robot does: lengths or angles of another unit.

    Judged from second to second, so that the jitter of fast trackers does not count.
    """
    measured = np.isfinite(poses[:, :2]).all(axis=1)
    seconds, first = np.unique(time_ns[measured] // 1_000_000_000, return_index=True)
    if len(seconds) <= FEW:
        return
    seen = poses[measured][first]
    elapsed, (dx, dy, turned) = np.diff(time_ns[measured][first]) * 1e-9, np.abs(np.diff(seen, axis=0).T)
    if (speed := _typical(np.hypot(dx, dy) / elapsed)) > FASTEST:
        fitting = {
            unit.value: now
            for unit in Unit
            if unit.dimension == "length" and (now := speed * unit.factor / mapping.unit.factor) <= FASTEST
        }
        likely = min(fitting, key=lambda unit: abs(np.log(fitting[unit] / USUAL)), default="")
        advice = f"declare log.reference.unit: {likely}?" if likely else "are its columns positions?"
        problem = f"as {mapping.unit.value} the reference moves at {speed:.3g} m/s, faster than any robot"
        raise LogSchema(source, "unit", f"{problem}; {advice}")
    if mapping.angle_unit is Unit.RAD and (rate := _typical(turned / elapsed)) > LONG_TURN:
        problem = f"as rad the reference turns at {rate:.3g} rad/s, faster than any robot"
        raise LogSchema(source, "unit", f"{problem}; declare log.reference.angle_unit: deg?")


def _typical(rates: Floats) -> float:
    """The median of the rates that are not nearly zero; 0 where there are none, or few."""
    moving = rates[rates > 1e-3]
    return float(np.median(moving)) if len(moving) >= FEW else 0.0


def _joined(steps: Floats) -> Floats:
    """Poses after steps, each in the frame that the one before led to."""
    heading = np.cumsum(steps[:, 2])
    before = heading - steps[:, 2]
    c, s = np.cos(before), np.sin(before)
    x, y = c * steps[:, 0] - s * steps[:, 1], s * steps[:, 0] + c * steps[:, 1]
    return np.stack([np.cumsum(x), np.cumsum(y), heading], axis=-1)


def jumps(trajectory: Trajectory) -> npt.NDArray[np.int64]:
    """Stamps of the poses that nothing can have reached from the pose before: a reset, or a hand.

    Args:
        trajectory: Poses that are logged when they change, so that a long step is one of a single cycle.
    """
    if len(trajectory) < 3:
        return np.empty(0, np.int64)
    elapsed = np.diff(trajectory.time_ns) * 1e-9
    elapsed = np.minimum(elapsed, 2.0 * float(np.median(elapsed)))
    step = np.diff(trajectory.poses, axis=0)
    far = np.hypot(step[:, 0], step[:, 1]) > FASTEST * elapsed
    turned = np.abs(se2.wrap(step[:, 2])) > FASTEST_TURN * elapsed  # not where headings are NaN
    stamps: npt.NDArray[np.int64] = trajectory.time_ns[1:][far | turned]
    return stamps
