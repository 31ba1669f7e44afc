"""Paths: curves one after the other, and how a robot points on them."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Iterable, Sequence
from itertools import groupby, pairwise

import msgspec

from trundle.errors import InputError, PathError, row_of, shown
from trundle.follow.curve import Curve
from trundle.geometry import Pose2D, Twist2D, wrap

__all__ = ["Path", "PathPoint"]

_GAP = 1e-6  # between two curves that meet [m]
_CORNER = 1e-4  # between their courses [rad]


class PathPoint(msgspec.Struct, frozen=True, gc=False):
    """Where a robot is on a path, and how it moves there per metre of it.

    Attributes:
        distance: Along the path [m].
        pose: Of the robot; its heading is not wrapped, and continuous along the path.
        course: Direction in which the path runs [rad].
        curvature: Change of the course per distance [1/m].
        turn: Change of the heading per distance [rad/m]: the curvature, unless the heading is its own.
        turn_change: Change of that per distance [rad/m^2].
        forward: Share of the motion that is along the robot's x axis: 1, or -1 backwards.
        leftward: Share that is along its y axis.
    """

    distance: float
    pose: Pose2D
    course: float
    curvature: float
    turn: float
    turn_change: float
    forward: float
    leftward: float

    @property
    def x(self) -> float:
        """[m]."""
        return self.pose.x

    @property
    def y(self) -> float:
        """[m]."""
        return self.pose.y

    @property
    def motion(self) -> Twist2D:
        """Body displacement per metre of the path: times a speed, it is the body twist."""
        return Twist2D(self.forward, self.leftward, self.turn)


class Path:
    """Curves one after the other. Immutable.

    `Path([...]) + Path([...], backward=True)` drives the second part backwards: the robot stops at the
    cusp between them and keeps its heading.

    Args:
        curves: Each begins where, and with the course with which, the one before it ends.
        backward: Drive them tail first.
        facing: Headings at the beginning and at the end [rad], between which the robot turns smoothly
            over the whole path, whatever its course: for drives that move in any direction.

    Attributes:
        length: From end to end [m].
        facing: As given.

    Raises:
        PathError: If there is no curve, there is a gap or a corner between two, or a path is both
            backward and facing somewhere.
    """

    def __init__(
        self, curves: Iterable[Curve], *, backward: bool = False, facing: tuple[float, float] | None = None
    ) -> None:
        listed = row_of(curves)
        if listed is None or not all(hasattr(curve, "nearest") for curve in listed):
            raise PathError(f"curves: {shown(curves)}, must be a list of curves")
        if backward and facing is not None:
            raise PathError("a path that is `facing` somewhere is not `backward`: the headings say it all")
        if facing is not None and not all(map(math.isfinite, facing)):
            raise PathError(f"facing: {facing}, must be two finite headings [rad]")
        self._join([(curve, backward) for curve in listed], facing)

    def _join(self, parts: Sequence[tuple[Curve, bool]], facing: tuple[float, float] | None) -> None:
        if not parts:
            raise PathError("a path needs one curve or more; none was given")
        self._parts = tuple(parts)
        self.facing = facing
        self._starts = [0.0]
        for curve, _ in parts:
            self._starts.append(self._starts[-1] + curve.length)
        self.length = self._starts.pop()
        # What is added to each curve's course to have a heading without jumps: half turns where the robot
        # backs, whole ones where a curve counts its turns from elsewhere.
        self._turned = [math.pi if parts[0][1] else 0.0]
        for k, ((before, was_backward), (after, backward)) in enumerate(pairwise(parts)):
            end, begin = before.at(before.length), after.at(0.0)
            where = f"({begin.x:g}, {begin.y:g}) m, {self._starts[k + 1]:g} m along the path"
            gap = math.dist((end.x, end.y), (begin.x, begin.y))
            if not gap <= _GAP:
                raise PathError(
                    f"a gap of {gap:g} m before {where}: curves must begin where the last one ends"
                )
            heading = end.course + self._turned[-1]
            corner = wrap(begin.course - end.course - (math.pi if backward != was_backward else 0.0))
            if not abs(corner) <= _CORNER:
                raise PathError(
                    f"a corner of {math.degrees(corner):.3g} degrees at {where}: round it with an arc or "
                    "spline; to back out of it, add a Path(..., backward=True)"
                )
            self._turned.append(heading + corner - begin.course)

    def __add__(self, other: Path) -> Path:
        """This path, then the other.

        Raises:
            PathError: If they do not meet, or one of them is `facing` somewhere.
        """
        if not isinstance(other, Path):
            return NotImplemented
        if self.facing is not None or other.facing is not None:
            raise PathError("paths that are `facing` somewhere cannot be added: make one of all curves")
        return Path._of((*self._parts, *other._parts))

    @staticmethod
    def _of(parts: Sequence[tuple[Curve, bool]], facing: tuple[float, float] | None = None) -> Path:
        path = Path.__new__(Path)
        path._join(parts, facing)
        return path

    @property
    def curves(self) -> tuple[tuple[float, Curve], ...]:
        """The curves, each with the distance at which it begins [m]."""
        return tuple((start, curve) for start, (curve, _) in zip(self._starts, self._parts, strict=True))

    @property
    def legs(self) -> tuple[Path, ...]:
        """The parts between cusps, each a path that is driven all forward or all backward."""
        if self.facing is not None:
            return (self,)
        groups = groupby(self._parts, key=lambda part: part[1])
        return tuple(Path._of(tuple(parts)) for _, parts in groups)

    @property
    def backward(self) -> bool:
        """Whether it begins backwards."""
        return self._parts[0][1]

    def at(self, distance: float) -> PathPoint:
        """The point after a distance [m]; beyond an end, the end. At a cusp, the beginning of what follows.

        Raises:
            InputError: If the distance is not a number.
        """
        if math.isnan(distance):
            raise InputError("distance along the path: nan, must be a number [m]")
        distance = min(max(distance, 0.0), self.length)
        k = bisect_right(self._starts, distance) - 1
        return self.on_curve(k, distance - self._starts[k])

    def on_curve(self, index: int, distance: float) -> PathPoint:
        """The point after a distance [m] on one of `curves`, its ends included."""
        curve, backward = self._parts[index]
        start = self._starts[index]
        point = curve.at(min(max(distance, 0.0), curve.length))
        turned = self._turned[index]
        course, curvature, change = point.course, point.curvature, point.curvature_change
        if self.facing is None:
            pose = Pose2D(point.x, point.y, course + turned)
            forward = -1.0 if backward else 1.0
            return PathPoint(start + distance, pose, course, curvature, curvature, change, forward, 0.0)
        heading, turn, turn_change = _blend(*self.facing, start + distance, self.length)
        aside = course - heading
        return PathPoint(
            start + distance,
            Pose2D(point.x, point.y, heading),
            course,
            curvature,
            turn,
            turn_change,
            math.cos(aside),
            math.sin(aside),
        )

    def nearest(self, x: float, y: float) -> float:
        """The distance along the path [m] of the point of it that is nearest to (x, y).

        Raises:
            InputError: If they are not finite.
        """
        if not math.isfinite(x + y):
            raise InputError(f"nearest: ({x}, {y}), must be finite [m]")

        def away(distance: float) -> float:
            point = self.at(distance)
            return math.dist((x, y), (point.x, point.y))

        candidates = [
            start + curve.nearest(x, y) for start, (curve, _) in zip(self._starts, self._parts, strict=True)
        ]
        return min(candidates, key=away)


def _blend(start: float, end: float, distance: float, length: float) -> tuple[float, float, float]:
    """From one value to another without a jump in the first two derivatives (Perlin's smootherstep)."""
    share, change = distance / length, end - start
    rest = 1.0 - share
    value = share**3 * (10.0 - share * (15.0 - 6.0 * share))
    slope = 30.0 * share * share * rest * rest
    bend = 60.0 * share * rest * (1.0 - 2.0 * share)
    return start + change * value, change * slope / length, change * bend / (length * length)
