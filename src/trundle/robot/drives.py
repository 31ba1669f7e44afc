"""The drives that have names: each takes the lengths that people know and places the wheels.

Widths and lengths are full distances between wheel contacts [m]. Every drive takes `measured` (whose
rotation is read) and `reference` (whose motion is reported); see `Kinematics`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from numbers import Integral
from typing import Any

from trundle.errors import ConfigError, did_you_mean, require_finite, require_positive, row_of, shown
from trundle.robot.kinematics import Kinematics
from trundle.robot.traced import nominal, trigonometry
from trundle.robot.wheel import Wheel

__all__ = [
    "DRIVES",
    "Ackermann",
    "Bicycle",
    "Custom",
    "Differential",
    "FourWheelSteering",
    "Mecanum",
    "Omni",
    "SkidSteer",
    "Swerve",
    "TrackingWheels",
    "Tricycle",
]

Radius = float | Mapping[str, float]
Measured = str | Sequence[str] | None
Point = tuple[float, float]

_MOST_WHEELS = 100
_INCH = 0.0254  # m
FOUR_WHEELS = ("front_left", "front_right", "rear_left", "rear_right")


class Differential(Kinematics):
    """Two fixed wheels on one axle. Reference: the middle of the axle.

    Args:
        track_width: Distance between the wheels [m].
        wheel_radius: Of both, or by wheel name [m].
        measured: See `Kinematics`.
        reference: See `Kinematics`.
    """

    type_name = "differential"

    def __init__(
        self,
        *,
        track_width: float,
        wheel_radius: Radius,
        measured: Measured = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        half = require_positive("track_width", track_width) / 2
        radius = _radii(wheel_radius, ("left", "right"))
        wheels = [
            Wheel("left", 0.0, half, radius["left"]),
            Wheel("right", 0.0, -half, radius["right"]),
        ]
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {"track_width": track_width, "wheel_radius": wheel_radius}


class SkidSteer(Kinematics):
    """Four fixed wheels (or two tracks) that slip sideways to turn. Reference: their centroid.

    Args:
        track_width: Effective distance between the sides [m]: for a robot that slips it is larger
            than the one that a ruler gives.
        wheelbase: Distance between front and rear wheels [m].
        wheel_radius: Of all, or by wheel name [m].
        icr_left: y of the left side's instantaneous centre of rotation [m]; half the track width
            where it is not given.
        icr_right: The right side's, a negative number.
        icr_x: x of the point that does not move sideways [m].
        measured: See `Kinematics`.
        reference: See `Kinematics`.

    Source:
        Mandow et al. 2007, "Experimental kinematics for wheeled skid-steer mobile robots".
    """

    type_name = "skid_steer"

    def __init__(
        self,
        *,
        track_width: float,
        wheelbase: float,
        wheel_radius: Radius,
        icr_left: float | None = None,
        icr_right: float | None = None,
        icr_x: float = 0.0,
        measured: Measured = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        half = require_positive("track_width", track_width) / 2
        left = half if icr_left is None else require_finite("icr_left", icr_left)
        right = -half if icr_right is None else require_finite("icr_right", icr_right)
        if not nominal(left) > nominal(right):
            raise ConfigError("icr_left", f"{left:g}, must be > icr_right ({right:g})")
        front = require_positive("wheelbase", wheelbase) / 2
        radius = _radii(wheel_radius, FOUR_WHEELS)
        corners = ((front, left), (front, right), (-front, left), (-front, right))
        wheels = [
            Wheel(name, x, y, radius[name], kind="skid")
            for name, (x, y) in zip(FOUR_WHEELS, corners, strict=True)
        ]
        super().__init__(
            wheels, measured=measured, reference=reference, skid_x=require_finite("icr_x", icr_x)
        )
        self.parameters = {
            "track_width": track_width,
            "wheelbase": wheelbase,
            "wheel_radius": wheel_radius,
            "icr_left": icr_left,
            "icr_right": icr_right,
            "icr_x": icr_x,
        }


class Bicycle(Kinematics):
    """One fixed wheel behind one steered wheel. Reference: the rear wheel's contact.

    Args:
        wheelbase: Distance between the wheels [m].
        wheel_radius: Of both, or by wheel name [m].
        measured: "rear" (omega = v tan(steering) / wheelbase), "front" (omega = v sin(steering) /
            wheelbase), or both; the body is the same.
        max_steering: Greatest steering angle either way [rad]; None means no limit.
        reference: See `Kinematics`.
    """

    type_name = "bicycle"

    def __init__(
        self,
        *,
        wheelbase: float,
        wheel_radius: Radius,
        measured: Measured = "rear",
        max_steering: float | None = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        radius = _radii(wheel_radius, ("rear", "front"))
        wheels = [
            Wheel("rear", 0.0, 0.0, radius["rear"]),
            _steered("front", require_positive("wheelbase", wheelbase), 0.0, radius["front"], max_steering),
        ]
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {
            "wheelbase": wheelbase,
            "wheel_radius": wheel_radius,
            "max_steering": max_steering,
        }


class Ackermann(Kinematics):
    """Two fixed wheels behind two steered ones, each with its own angle. Reference: rear axle middle.

    Steering angles are given as (front left, front right), or as the one angle of a virtual wheel
    midway between them. By default the rear wheels are measured.

    Args:
        wheelbase: Distance between the axles [m].
        track_width: Distance between left and right wheels [m].
        wheel_radius: Of all, or by wheel name [m].
        measured: See `Kinematics`.
        max_steering: Greatest steering angle of a front wheel either way [rad]; None: no limit.
        reference: See `Kinematics`.
    """

    type_name = "ackermann"

    def __init__(
        self,
        *,
        wheelbase: float,
        track_width: float,
        wheel_radius: Radius,
        measured: Measured = ("rear_left", "rear_right"),
        max_steering: float | None = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        length, half = (
            require_positive("wheelbase", wheelbase),
            require_positive("track_width", track_width) / 2,
        )
        radius = _radii(wheel_radius, FOUR_WHEELS)
        wheels = [
            _steered("front_left", length, half, radius["front_left"], max_steering),
            _steered("front_right", length, -half, radius["front_right"], max_steering),
            Wheel("rear_left", 0.0, half, radius["rear_left"]),
            Wheel("rear_right", 0.0, -half, radius["rear_right"]),
        ]
        super().__init__(wheels, measured=measured, reference=reference)
        self._length, self._half = length, half
        self.parameters = {
            "wheelbase": wheelbase,
            "track_width": track_width,
            "wheel_radius": wheel_radius,
            "max_steering": max_steering,
        }

    def expand_steering(self, steering: Sequence[Any], trig: Any = math) -> Sequence[Any]:
        """(left, right) from one virtual middle angle: `cot(left) = cot(middle) - half/length`.

        Raises:
            ShapeError: If there is not one angle.
        """
        if len(steering) != 1:
            return super().expand_steering(steering)
        c, s = trig.cos(steering[0]), trig.sin(steering[0])
        atan2 = trig.atan2
        # Beyond the turning centre the wheel would point backwards; a line has no direction, so the
        # half turn is taken out by making the cosine positive.
        angles = []
        for half in (self._half, -self._half):
            ahead = self._length * c - half * s
            sign = (ahead >= 0) * 2.0 - 1.0
            angles.append(atan2(sign * self._length * s, sign * ahead))
        return angles


class Tricycle(Kinematics):
    """One steered and driven wheel ahead of one or two fixed ones. Reference: rear axle middle.

    Args:
        wheelbase: Distance from the rear axle to the steered wheel [m].
        wheel_radius: Of all, or by wheel name [m].
        track_width: Distance between the rear wheels [m]; without it there is one wheel, "rear".
        front_y: How far the steered wheel stands to the left of the middle [m].
        measured: By default the front wheel; see `Kinematics`.
        max_steering: Greatest steering angle either way [rad]; None means no limit.
        reference: See `Kinematics`.
    """

    type_name = "tricycle"

    def __init__(
        self,
        *,
        wheelbase: float,
        wheel_radius: Radius,
        track_width: float | None = None,
        front_y: float = 0.0,
        measured: Measured = "front",
        max_steering: float | None = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        length = require_positive("wheelbase", wheelbase)
        offset = require_finite("front_y", front_y)
        if track_width is None:
            radius = _radii(wheel_radius, ("front", "rear"))
            rear = [Wheel("rear", 0.0, 0.0, radius["rear"], driven=False)]
        else:
            half = require_positive("track_width", track_width) / 2
            radius = _radii(wheel_radius, ("front", "rear_left", "rear_right"))
            rear = [
                Wheel("rear_left", 0.0, half, radius["rear_left"], driven=False),
                Wheel("rear_right", 0.0, -half, radius["rear_right"], driven=False),
            ]
        wheels = [_steered("front", length, offset, radius["front"], max_steering), *rear]
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {
            "wheelbase": wheelbase,
            "wheel_radius": wheel_radius,
            "track_width": track_width,
            "front_y": front_y,
            "max_steering": max_steering,
        }


class FourWheelSteering(Kinematics):
    """Four steered wheels. Reference: their centroid.

    Args:
        wheelbase: Distance between front and rear wheels [m].
        track_width: Distance between left and right wheels [m].
        wheel_radius: Of all, or by wheel name [m].
        measured: See `Kinematics`.
        max_steering: Greatest steering angle either way [rad]; None means no limit.
        reference: See `Kinematics`.
    """

    type_name = "four_wheel_steering"

    def __init__(
        self,
        *,
        wheelbase: float,
        track_width: float,
        wheel_radius: Radius,
        measured: Measured = None,
        max_steering: float | None = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        radius = _radii(wheel_radius, FOUR_WHEELS)
        wheels = [
            _steered(name, x, y, radius[name], max_steering)
            for name, x, y in _corners(wheelbase, track_width)
        ]
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {
            "wheelbase": wheelbase,
            "track_width": track_width,
            "wheel_radius": wheel_radius,
            "max_steering": max_steering,
        }


class Mecanum(Kinematics):
    """Four mecanum wheels whose contacts roll freely towards the X. Reference: their centroid.

    Seen through the robot on the ground, the contacts roll freely along +45, -45, -45, +45 degrees
    (FL, FR, RL, RR); seen from above, the rollers form an X.

    Args:
        track_width: Distance between left and right wheels [m], not its half.
        wheelbase: Distance between front and rear wheels [m], not its half.
        wheel_radius: Of all, or by wheel name [m].
        measured: See `Kinematics`.
        reference: See `Kinematics`.
    """

    type_name = "mecanum"

    def __init__(
        self,
        *,
        track_width: float,
        wheelbase: float,
        wheel_radius: Radius,
        measured: Measured = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        radius = _radii(wheel_radius, FOUR_WHEELS)
        quarter = math.pi / 4
        wheels = [
            Wheel(name, x, y, radius[name], kind="swedish", free_direction=sign * quarter)
            for (name, x, y), sign in zip(_corners(wheelbase, track_width), (1, -1, -1, 1), strict=True)
        ]
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {
            "track_width": track_width,
            "wheelbase": wheelbase,
            "wheel_radius": wheel_radius,
        }


class Omni(Kinematics):
    """Omni wheels on a circle, each driving along its clockwise tangent. Reference: the centre.

    Wheels are called "wheel_1", "wheel_2", ... and stand counter-clockwise, as in ros2_controllers.

    Args:
        robot_radius: Radius of the circle on which the wheels stand [m].
        wheel_radius: Of all, or by wheel name [m].
        wheel_count: Three or more.
        first_wheel_angle: Where the first wheel stands, from +x [rad].
        measured: See `Kinematics`.
        reference: See `Kinematics`.
    """

    type_name = "omni"

    def __init__(
        self,
        *,
        robot_radius: float,
        wheel_radius: Radius,
        wheel_count: int = 3,
        first_wheel_angle: float = 0.0,
        measured: Measured = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        distance = require_positive("robot_radius", robot_radius)
        first = require_finite("first_wheel_angle", first_wheel_angle)
        if not isinstance(wheel_count, Integral) or not 3 <= wheel_count <= _MOST_WHEELS:
            raise ConfigError(
                "wheel_count", f"{shown(wheel_count)}, must be a whole number from 3 to {_MOST_WHEELS}"
            )
        names = tuple(f"wheel_{k + 1}" for k in range(int(wheel_count)))
        radius = _radii(wheel_radius, names)
        wheels = []
        for k, name in enumerate(names):
            angle = first + k * math.tau / wheel_count
            trig = trigonometry(angle)
            x, y = distance * trig.cos(angle), distance * trig.sin(angle)
            wheels.append(
                Wheel(name, x, y, radius[name], angle - math.pi / 2, kind="swedish", free_direction=angle)
            )
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {
            "robot_radius": robot_radius,
            "wheel_radius": wheel_radius,
            "wheel_count": wheel_count,
            "first_wheel_angle": first_wheel_angle,
        }


class Swerve(Kinematics):
    """Modules that steer and drive. Reference: the origin of their coordinates.

    Args:
        modules: Their places (x, y) [m], or the same by name. Four without names are called
            front_left, front_right, rear_left, rear_right; others module_1, module_2, ...
        wheel_radius: Of all, or by module name [m].
        measured: See `Kinematics`.
        max_steering: Greatest steering angle either way [rad]; None means they turn freely.
        reference: See `Kinematics`.
    """

    type_name = "swerve"

    def __init__(
        self,
        *,
        modules: Sequence[Point] | Mapping[str, Point],
        wheel_radius: Radius,
        measured: Measured = None,
        max_steering: float | None = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        places = _named_places("modules", modules, "module")
        radius = _radii(wheel_radius, tuple(places))
        wheels = [
            _steered(name, x, y, radius[name], max_steering)
            for name, place in places.items()
            for x, y in [_numbers("modules", name, place, 2)]
        ]
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {
            "modules": modules,
            "wheel_radius": wheel_radius,
            "max_steering": max_steering,
        }


class TrackingWheels(Kinematics):
    """Unpowered omni wheels with encoders ("dead wheels"). Reference: the origin of their coordinates.

    A positive reading means that the robot moved along the wheel's heading.

    Args:
        wheels: Their poses (x, y, heading) [m, m, rad], or the same by name; without names they
            are called wheel_1, wheel_2, ...
        wheel_radius: Of all, or by wheel name [m].
        measured: See `Kinematics`; two wheels need "gyro" as well.
        reference: See `Kinematics`.
    """

    type_name = "tracking_wheels"

    def __init__(
        self,
        wheels: Sequence[tuple[float, float, float]] | Mapping[str, tuple[float, float, float]],
        wheel_radius: Radius,
        *,
        measured: Measured = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        places = _named_places("wheels", wheels, "wheel")
        radius = _radii(wheel_radius, tuple(places))
        placed = []
        for name, place in places.items():
            x, y, heading = _numbers("wheels", name, place, 3)
            placed.append(Wheel(name, x, y, radius[name], heading, kind="tracking", driven=False))
        super().__init__(placed, measured=measured, reference=reference)
        self.parameters = {"wheels": wheels, "wheel_radius": wheel_radius}

    @classmethod
    def in_inches(
        cls,
        wheels: Sequence[tuple[float, float, float]] | Mapping[str, tuple[float, float, float]],
        wheel_radius: Radius = 1.0,
        *,
        measured: Measured = None,
    ) -> TrackingWheels:
        """The same with places and radii in inches at this door; inside, all is metres.

        With the radius left at 1 in, a wheel turns by one radian per inch: readings may then be given
        as the inches that the wheels rolled.

        Args:
            wheels: Their poses (x, y, heading) [in, in, rad], or the same by name.
            wheel_radius: Of all, or by wheel name [in].
            measured: See `Kinematics`.
        """
        places = {
            name: (_INCH * x, _INCH * y, heading)
            for name, place in _named_places("wheels", wheels, "wheel").items()
            for x, y, heading in [_numbers("wheels", name, place, 3)]
        }
        radii = {name: _INCH * radius for name, radius in _radii(wheel_radius, tuple(places)).items()}
        return cls(places, radii, measured=measured)


class Custom(Kinematics):
    """Any wheels anywhere: a six-wheel rover needs no new code. Reference: the origin.

    Args:
        wheels: The wheels.
        measured: See `Kinematics`.
        reference: See `Kinematics`.
    """

    type_name = "custom"

    def __init__(
        self,
        *,
        wheels: Sequence[Wheel],
        measured: Measured = None,
        reference: Point = (0.0, 0.0),
    ) -> None:
        super().__init__(wheels, measured=measured, reference=reference)
        self.parameters = {"wheels": tuple(wheels)}


DRIVES: Mapping[str, type[Kinematics]] = {
    drive.type_name: drive
    for drive in (
        Differential,
        SkidSteer,
        Bicycle,
        Ackermann,
        Tricycle,
        FourWheelSteering,
        Mecanum,
        Omni,
        Swerve,
        TrackingWheels,
        Custom,
    )
}
"""Drives by the word that robot.yaml calls them."""


def _radii(radius: Radius, names: Sequence[str]) -> dict[str, float]:
    """One radius per wheel, from one for all or one per name."""
    if not isinstance(radius, Mapping):
        value = require_positive("wheel_radius", radius)
        return dict.fromkeys(names, value)
    for name in radius:
        if name not in names:
            raise ConfigError(f"wheel_radius.{name}", f"no such wheel, {did_you_mean(str(name), names)}")
    missing = [name for name in names if name not in radius]
    if missing:
        raise ConfigError("wheel_radius", f"no radius for {', '.join(missing)}")
    return {name: require_positive(f"wheel_radius.{name}", radius[name]) for name in names}


def _steered(name: str, x: float, y: float, radius: float, max_steering: float | None) -> Wheel:
    reach = None if max_steering is None else require_positive("max_steering", max_steering)
    return Wheel(
        name, x, y, radius, kind="steered", steering_range=None if reach is None else (-reach, reach)
    )


def _corners(wheelbase: float, track_width: float) -> list[tuple[str, float, float]]:
    x, y = require_positive("wheelbase", wheelbase) / 2, require_positive("track_width", track_width) / 2
    return list(zip(FOUR_WHEELS, (x, x, -x, -x), (y, -y, y, -y), strict=True))


def _named_places(
    field: str, places: Sequence[Any] | Mapping[str, Any], word: str
) -> Mapping[str, Sequence[float]]:
    if isinstance(places, Mapping):
        return places
    listed = row_of(places)
    if listed is None:
        raise ConfigError(field, f"{shown(places)}, must be a list of places")
    names: Sequence[str] = [f"{word}_{k + 1}" for k in range(len(listed))]
    if word == "module" and len(listed) == 4:
        names = FOUR_WHEELS
    return dict(zip(names, listed, strict=True))


def _numbers(field: str, name: str, place: Sequence[float], count: int) -> list[float]:
    path = f"{field}.{name}"
    numbers = row_of(place)
    if numbers is None or len(numbers) != count:
        raise ConfigError(path, f"{shown(place)}, must be {count} numbers")
    return [require_finite(path, value) for value in numbers]
