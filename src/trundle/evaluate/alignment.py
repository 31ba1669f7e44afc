"""Bringing a trajectory into the frame of another."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import numpy.typing as npt

from trundle.errors import InputError, ShapeError, Unobservable, require_type
from trundle.geometry import Pose2D, se2
from trundle.records import Trajectory

__all__ = ["align", "align_origin", "require_matched", "since_start", "transform"]

Floats = npt.NDArray[np.float64]


def align(estimate: Trajectory, reference: Trajectory) -> Pose2D:
    """The rotation and translation that bring the estimate's positions closest to the reference's.

    Least squares over all positions, no scale; headings play no part. Samples belong together by
    index: `associate` first.

    Args:
        estimate: N >= 2 poses.
        reference: N poses; headings may be NaN.

    Returns:
        Pose T of the estimate's frame in the reference's: `T @ estimate` is near the reference.

    Raises:
        ShapeError: If the two differ in length.
        InputError: If there are fewer than two samples, or a position is not finite.
        Unobservable: If either stays at one point, which leaves the rotation open.

    Source:
        Kabsch 1976; Umeyama 1991. In the plane the best rotation is the argument of the sum of
        conj(estimate) * reference, both as complex numbers about their means.
    """
    require_matched(estimate, reference, at_least=2)
    (mean_e, e), (mean_r, r) = _centred("estimate", estimate), _centred("reference", reference)
    along = float(np.sum(e * r))
    across = float(np.sum(e[:, 0] * r[:, 1] - e[:, 1] * r[:, 0]))
    rotation = Pose2D(0.0, 0.0, math.atan2(across, along))
    moved = rotation @ Pose2D(*mean_e)
    return Pose2D(mean_r[0] - moved.x, mean_r[1] - moved.y, rotation.theta)


def align_origin(estimate: Trajectory, reference: Trajectory) -> Pose2D:
    """The pose of the estimate's frame in the reference's that makes the first poses equal.

    Raises:
        ShapeError: If the two differ in length.
        InputError: If they are empty, or the first pose of either has no heading.
    """
    require_matched(estimate, reference, at_least=1)
    if not np.isfinite(estimate.poses[0]).all() or not np.isfinite(reference.poses[0]).all():
        raise InputError(
            "the first poses need x, y and a heading to be put on each other; align() needs positions only"
        )
    return reference.pose(0) @ estimate.pose(0).inverse()


def transform(trajectory: Trajectory, pose: Pose2D, *, frame: str | None = None) -> Trajectory:
    """The same trajectory seen from another frame: `pose @ trajectory`.

    Twists and covariances are of the body frame and stay as they are.

    Args:
        trajectory: Poses in some frame.
        pose: That frame, in the wanted one.
        frame: Name of the wanted frame; None keeps the name.
    """
    require_type("transform", "trajectory", trajectory, Trajectory)
    require_type("transform", "pose", pose, Pose2D)
    poses = se2.compose(np.asarray([pose.x, pose.y, pose.theta]), trajectory.poses)
    return dataclasses.replace(trajectory, poses=poses, frame=trajectory.frame if frame is None else frame)


def since_start(trajectory: Trajectory) -> Trajectory:
    """The motion since the first sample: poses in the first pose's frame, with its error taken out.

    The errors of odometry add up along the way, so what it did not know at the start, carried along
    (`Ad P0 Ad^T`), is part of every later covariance, and the rest is what came after.

    Raises:
        InputError: If the trajectory is empty, or its first pose is not finite.
    """
    require_type("since_start", "trajectory", trajectory, Trajectory)
    if not len(trajectory) or not np.isfinite(trajectory.poses[0]).all():
        raise InputError("a motion needs a first pose with x, y and heading")
    start = trajectory.pose(0)
    moved = transform(trajectory, start.inverse(), frame=trajectory.child_frame)
    if trajectory.covariances is None:
        return moved
    carry = se2.adjoint(se2.inverse(moved.poses))
    carried = np.einsum("nij,jk,nlk->nil", carry, trajectory.covariances[0], carry)
    return dataclasses.replace(moved, covariances=trajectory.covariances - carried)


def require_matched(estimate: Trajectory, reference: Trajectory, *, at_least: int) -> None:
    """Refuse two trajectories whose samples do not belong together one by one.

    Raises:
        ShapeError: If they differ in length.
        InputError: If they are shorter than wanted.
    """
    for name, trajectory in (("estimate", estimate), ("reference", reference)):
        require_type("evaluate", name, trajectory, Trajectory)
    if len(estimate) != len(reference):
        raise ShapeError(
            f"estimate has {len(estimate)} samples, reference {len(reference)}, must be as many: "
            "associate() them first"
        )
    if len(estimate) < at_least:
        raise InputError(f"{len(estimate)} matched samples, must be at least {at_least}")


def _centred(name: str, trajectory: Trajectory) -> tuple[list[float], Floats]:
    """Mean position as (x, y, 0), and the positions about it."""
    positions = trajectory.poses[:, :2]
    if not np.isfinite(positions).all():
        raise InputError(f"{name}: a position is not finite: associate() leaves such samples out")
    mean = positions.mean(axis=0)
    centred = positions - mean
    if np.abs(centred).max() <= 1e-12 * np.abs(positions).max():
        raise Unobservable(
            f"{name}: all {len(positions)} positions are the same, which leaves the rotation of the best "
            "alignment open; align_origin() needs no motion"
        )
    return [*mean.tolist(), 0.0], centred
