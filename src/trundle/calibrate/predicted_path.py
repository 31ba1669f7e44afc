"""Where the wheels say that the robot went, how that depends on its numbers, and how sure it is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from array_api_compat import numpy as standard  # the array API, on NumPy 1.26 too

from trundle.calibrate.dual import Dual, DualMath, seeds
from trundle.calibrate.parameter import Parameter, drive_with
from trundle.calibrate.wheel_steps import wheel_steps
from trundle.errors import InputError
from trundle.geometry import se2
from trundle.odometry.covariance import rotated
from trundle.odometry.error_model import ErrorModel
from trundle.records import WheelLog
from trundle.robot import Robot

__all__ = ["PredictedPath", "Readings", "adjoint", "predict", "readings_of"]

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, slots=True, eq=False)
class Readings:
    """What the sensors of one run said, step by step.

    Attributes:
        moments: Ends of the steps, from the log's first row [s], shape (steps + 1,).
        turned: Angles of the measured wheels [rad], shape (measured, steps).
        steering: Angles in the middle of the steps [rad], shape (angles, steps).
        steering_names: Whose angles they are.
        turn: What the gyro turned [rad], shape (steps,), or None.
    """

    moments: Floats
    turned: Floats
    steering: Floats
    steering_names: tuple[str, ...]
    turn: Floats | None


def readings_of(robot: Robot, log: WheelLog) -> Readings:
    """The steps of a log, as its sensors said them.

    Raises:
        InputError: If the log lacks a wheel, an angle, or the gyro that the robot measures.
    """
    steps = wheel_steps(robot, log)
    start = (log.time_ns[steps.rows[0]] - log.time_ns[0]) * 1e-9
    names: tuple[str, ...] = ()
    angles = np.zeros((0, len(steps)))
    if robot.measuring.steered_names and log.steering is not None:
        names = log.steering_names
        said = log.steering[steps.rows]
        angles = 0.5 * (said[1:] + said[:-1]).T
    turn = None
    if robot.measuring.gyro:
        if log.yaw_rate is None:
            raise InputError(f"{log.source or 'the log'} has no gyro, which this robot measures")
        rates = log.yaw_rate[steps.rows]
        turn = 0.5 * (rates[1:] + rates[:-1]) * np.diff(steps.moments)
    return Readings(start + steps.moments, np.ascontiguousarray(steps.turned.T), angles, names, turn)


@dataclass(frozen=True, slots=True, eq=False)
class PredictedPath:
    """A path at some moments, from its own start.

    Attributes:
        poses: Of the reference point, shape (N, 3).
        slopes: Change of each pose by each parameter, as a displacement of the whole frame at the start
            (the left derivative), shape (N, 3, parameters).
        spread: Covariance of that displacement by the noise of the wheels, since the start, shape (N, 3, 3).
        twists: Body twists, shape (N, 3).
        distance: Way driven so far [m], shape (N,).
        turned: Heading gone through so far, whichever way [rad], shape (N,).
    """

    poses: Floats
    slopes: Floats
    spread: Floats
    twists: Floats
    distance: Floats
    turned: Floats


def predict(
    robot: Robot, readings: Readings, parameters: Sequence[Parameter], values: Floats, moments: Floats
) -> PredictedPath:
    """The path at some moments, by other numbers.

    Poses are exact arcs. Their derivatives are exact too: the drive's equation in numbers that carry theirs,
    then the product rule on the group: a change of step k moves all that follows.

    Args:
        robot: As described.
        readings: What its sensors said.
        parameters: Which numbers are others.
        values: The numbers.
        moments: When, from the log's first row [s], shape (N,); outside the log its ends count.
    """
    numbers = seeds(values)
    step, slopes = _displacements(robot, readings, parameters, numbers)
    poses = _walk(step)
    changes = _sums(_moved(poses[:, 1:], step, slopes))
    spread = _sums(_spatial_noise(robot, readings, parameters, values, step, poses))
    way, turn = np.hypot(step[0], step[1]), np.abs(step[2])
    distance, turned = _sums(way), _sums(turn)

    ends = readings.moments
    k = np.clip(np.searchsorted(ends, moments, side="right") - 1, 0, step.shape[1] - 1)
    elapsed = ends[k + 1] - ends[k]
    share = np.clip((moments - ends[k]) / elapsed, 0.0, 1.0)
    part = share * step[:, k]
    found = se2.compose(poses[:, k].T, se2.exp(part.T))
    inside = _moved(found.T, part, share * slopes[:, :, k])
    return PredictedPath(
        poses=found,
        slopes=(changes[:, :, k] + inside).transpose(2, 1, 0),
        spread=_matrices((1.0 - share) * spread[:, k] + share * spread[:, k + 1]),
        twists=(step[:, k] / elapsed).T,
        distance=distance[k] + share * way[k],
        turned=turned[k] + share * turn[k],
    )


def adjoint(poses: Floats) -> Floats:
    """Adjoints of poses (x, y, theta), shape (N, 3, 3)."""
    x, y, theta = poses.T
    c, s = np.cos(theta), np.sin(theta)
    found = np.zeros((len(poses), 3, 3))
    found[:, 0, 0], found[:, 0, 1], found[:, 0, 2] = c, -s, y
    found[:, 1, 0], found[:, 1, 1], found[:, 1, 2] = s, c, -x
    found[:, 2, 2] = 1.0
    return found


def _displacements(
    robot: Robot, readings: Readings, parameters: Sequence[Parameter], numbers: Sequence[Dual]
) -> tuple[Floats, Floats]:
    """Body displacements, shape (3, steps), and their derivatives, shape (parameters, 3, steps)."""
    drive = drive_with(robot.measuring, parameters, numbers)
    sensors = {one.name: number for one, number in zip(parameters, numbers, strict=True)}
    angles = [
        sensors.get(f"steering.{name}.gain", 1.0) * angle + sensors.get(f"steering.{name}.offset", 0.0)
        for name, angle in zip(readings.steering_names, readings.steering, strict=True)
    ]
    if len(angles) < len(drive.steered_names):
        angles = list(drive.expand_steering(angles, DualMath))
    turn: Dual | Floats | None = readings.turn
    if turn is not None:
        seconds = np.diff(readings.moments)
        turn = sensors.get("gyro.scale", 1.0) * turn + sensors.get("gyro.bias", 0.0) * seconds
    columns = drive.displacement(list(readings.turned), angles, turn, DualMath)
    count = readings.turned.shape[1]
    step = np.zeros((3, count))
    slopes = np.zeros((len(parameters), 3, count))
    for axis, column in enumerate(columns):
        if isinstance(column, Dual):
            step[axis] = column.value
            slopes[:, axis] = column.slopes
        else:
            step[axis] = column
    return step, slopes


def _walk(step: Floats) -> Floats:
    """Poses after each step, from the origin, shape (3, steps + 1)."""
    dx, dy, turn = step
    half = 0.5 * turn
    heading = np.concatenate([[0.0], np.cumsum(turn)])
    chord = se2.sinc(half)
    c, s = np.cos(heading[:-1] + half) * chord, np.sin(heading[:-1] + half) * chord
    return np.stack([_sums(c * dx - s * dy), _sums(s * dx + c * dy), heading])


def _moved(ends: Floats, step: Floats, changes: Floats) -> Floats:
    """What changes of steps do to all poses after them: Ad(end) Jr(step) change, by columns.

    Args:
        ends: Poses after the steps, shape (3, steps).
        step: The steps, shape (3, steps).
        changes: Of the steps, shape (parameters, 3, steps).
    """
    x, y, heading = ends
    dx, dy, turn = step
    half = 0.5 * turn
    # Entries of se2.right_jacobian, and its rows turned by the heading.
    a, b = se2.sinc(turn), np.sin(half) * se2.sinc(half)
    e, d = se2.excess(turn), 0.5 * se2.sinc(half) ** 2
    p, q = e * dx - d * dy, d * dx + e * dy
    c, s = np.cos(heading), np.sin(heading)
    along, across = c * a + s * b, c * b - s * a
    by_turn_x, by_turn_y = c * p - s * q + y, s * p + c * q - x
    cx, cy, ct = changes[:, 0], changes[:, 1], changes[:, 2]
    found = np.empty_like(changes)
    found[:, 0] = along * cx + across * cy + by_turn_x * ct
    found[:, 1] = along * cy - across * cx + by_turn_y * ct
    found[:, 2] = ct
    return found


def _spatial_noise(
    robot: Robot,
    readings: Readings,
    parameters: Sequence[Parameter],
    values: Floats,
    step: Floats,
    poses: Floats,
) -> Floats:
    """Upper triangles of the covariance of each step, seen from the start, shape (6, steps)."""
    drive = drive_with(robot.measuring, parameters, [float(value) for value in values])
    model = ErrorModel(drive, robot.noise, {})
    angles: list[Floats] = list(readings.steering)
    if len(angles) < len(drive.steered_names):
        angles = list(drive.expand_steering(angles, standard))
    gyro = readings.turn is not None
    gains = model.gains(angles, gyro, standard)
    six = model.noise(gains, list(readings.turned), list(step), np.diff(readings.moments), gyro, standard)
    middle = 0.5 * (poses[:, 1:] + poses[:, :-1])
    x, y, heading = middle
    xx, xy, yy, xt, yt, tt = rotated(six, np.cos(heading), np.sin(heading))
    far_x, far_y = xt + y * tt, yt - x * tt
    parts = (xx + y * (xt + far_x), xy - x * xt + y * far_y, yy - x * (yt + far_y), far_x, far_y, tt)
    return np.stack([np.broadcast_to(part, heading.shape) for part in parts])


def _matrices(six: Floats) -> Floats:
    """Symmetric matrices, shape (N, 3, 3), of their upper triangles, shape (6, N)."""
    xx, xy, yy, xt, yt, tt = six
    return np.stack([xx, xy, xt, xy, yy, yt, xt, yt, tt], axis=-1).reshape(-1, 3, 3)


def _sums(parts: Floats) -> Floats:
    """Running sums along the last axis, beginning with zero."""
    found = np.zeros((*parts.shape[:-1], parts.shape[-1] + 1))
    np.cumsum(parts, axis=-1, out=found[..., 1:])
    return found
