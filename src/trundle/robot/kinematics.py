"""A drive: wheels, which of them are measured, and the two directions of the one equation."""

from __future__ import annotations

import math
from collections.abc import Sequence
from math import atan2, hypot, pi, remainder, tau
from typing import Any, NamedTuple, overload

from msgspec.structs import replace

from trundle.errors import (
    ConfigError,
    Infeasible,
    InputError,
    ShapeError,
    did_you_mean,
    require_finite,
    require_numbers,
    require_type,
    row_of,
    shown,
)
from trundle.geometry import Twist2D
from trundle.robot import observability
from trundle.robot.least_squares import null_space
from trundle.robot.rows import Row, contact, rolling, sideways
from trundle.robot.solver import Driving, Gains, Leaning, Rolling, Solver
from trundle.robot.traced import array_library, nominal, surely
from trundle.robot.wheel import Wheel, WheelKind
from trundle.robot.wheel_command import WheelCommand

__all__ = ["Kinematics", "SteeringBounds"]

Array = Any  # any array of the array-API standard

_FEASIBLE = 1e-9  # relative: what rounding leaves of a constraint that holds
_STANDSTILL = 16.0 * 2.0**-52  # relative: below this a contact velocity is rounding, not motion
_QUARTER = math.pi / 2.0
_STEEPEST = math.radians(89.0)
_LONGEST_REPR = 120
_SLACK = 1e-9  # a wheel commanded to its stop is not beyond it [rad]


class SteeringBounds(NamedTuple):
    """Which angles of a steered wheel can be believed [rad].

    Attributes:
        least: End of its range.
        greatest: The other end.
        leaning: Its rotation is not measured: square to its rolling direction it says nothing, so
            beyond 89 degrees it is refused (FAULTS.md S18).
    """

    least: float
    greatest: float
    leaning: bool

    def hold(self, angle: Any, trig: Any = math) -> Any:
        """Whether the angle, or each angle of an array, is within them. NaN is not."""
        inside = (angle >= self.least - _SLACK) & (angle <= self.greatest + _SLACK)
        if not self.leaning:
            return inside
        whole_turns = round(angle / math.pi) if trig is math else trig.round(angle / math.pi)
        return inside & (abs(angle - math.pi * whole_turns) <= _STEEPEST)


class Kinematics:
    """The kinematics of one drive. Immutable; all named drives are this with wheels placed.

    Args:
        wheels: The wheels, in the order that commands list them.
        measured: Name or names of the wheels whose rotation is read, and "gyro" where a gyro is;
            None means all that can be.
        reference: Point (x, y) [m] whose motion is reported, in the frame that the wheels are in.
        skid_x: Where along x the body of a skid drive does not move sideways [m]; None means the
            middle of its wheels.

    Attributes:
        wheels: As given, in the frame of the reference point.
        wheel_names: All wheels but casters: the order of `WheelCommand.speeds`.
        steered_names: The order of `WheelCommand.steering`.
        measured_names: The wheels whose rotation `forward` and odometry are given, in that order.
        gyro: Whether a yaw rate is measured too.
        condition: Condition number of the rows, lengths in RMS distances of the wheels.
        steering_bounds: Per steered wheel, which angles can be believed.

    Raises:
        ConfigError: If a value is impossible, or the wheels would have to slip.
        Singular: If what is measured can never determine the motion.
    """

    type_name = "custom"
    parameters: dict[str, Any]

    def __init__(
        self,
        wheels: Sequence[Wheel],
        *,
        measured: str | Sequence[str] | None = None,
        reference: tuple[float, float] = (0.0, 0.0),
        skid_x: float | None = None,
    ) -> None:
        point = row_of(reference)
        if point is None or len(point) != 2:
            raise ConfigError("reference", f"{shown(reference)}, must be (x, y)")
        rx, ry = (require_finite("reference", part) for part in point)
        given: tuple[Wheel, ...] | None = row_of(wheels)
        if given is None or not all(isinstance(wheel, Wheel) for wheel in given):
            raise ConfigError("wheels", f"{shown(wheels)}, must be a list of Wheel(name, x, y, radius)")
        self.wheels = tuple(replace(wheel, x=wheel.x - rx, y=wheel.y - ry) for wheel in given)
        self.reference = (rx, ry)
        speaking = [wheel for wheel in self.wheels if wheel.kind is not WheelKind.CASTER]
        self._speaking = speaking
        self.wheel_names = tuple(wheel.name for wheel in speaking)
        self._check_names()
        self._steered = [wheel for wheel in speaking if wheel.kind is WheelKind.STEERED]
        self.steered_names = tuple(wheel.name for wheel in self._steered)
        self.measured_names, self.gyro = self._choose_measured(measured)
        self._measured = [self.wheel(name) for name in self.measured_names]

        points = [(wheel.x, wheel.y) for wheel in speaking]
        *_, self._scale = observability.length_scale(points)
        self._skid_x = None if skid_x is None else require_finite("skid_x", skid_x) - rx
        rows = self._constraint_rows(self._skid_x)
        self._constraints = tuple(rows[i] for i in observability.independent(rows, points))
        self._null = null_space(self._constraints, (1.0, 1.0, self._scale))
        observability.check_constraints(self._null)
        self.condition = observability.check_observable([*self._constraints, *self._observed_rows()], points)
        self.steering_bounds = tuple(
            SteeringBounds(
                *(wheel.steering_range or (-math.inf, math.inf)), wheel.name not in self.measured_names
            )
            for wheel in self._steered
        )
        self._solvers: dict[bool, Solver] = {}
        self._standstill = (0.0,) * len(self._steered)
        self._reach = max((abs(wheel.x) + abs(wheel.y) for wheel in self._steered), default=0.0)
        self._plan = [self._planned(wheel) for wheel in speaking]
        # Where nothing steers, K with the radii in it: the live path's one product.
        self._columns_of_turned: list[tuple[float, ...]] | None = None
        if not self._steered and self.observable_without_gyro:
            columns = self.gains(gyro=False).rolling
            self._columns_of_turned = [
                tuple(gain * wheel.radius for gain in column)
                for column, wheel in zip(columns, self._measured, strict=True)
            ]

    # --- construction -----------------------------------------------------------------------

    def _planned(self, wheel: Wheel) -> tuple[float, float, float, tuple[Any, ...] | None]:
        """What `inverse` needs of one wheel: its speed's row, or where it stands and how it is steered."""
        if wheel.kind is WheelKind.STEERED:
            limited = None if wheel.steering_range is None else wheel
            return (0.0, 0.0, 0.0, (wheel.x, wheel.y, wheel.heading, wheel.radius, limited))
        a, b, c = rolling(wheel)
        return (a / wheel.radius, b / wheel.radius, c / wheel.radius, None)

    def _check_names(self) -> None:
        if not self.wheel_names:
            raise ConfigError("wheels", "none given that says anything about the motion")
        names = [wheel.name for wheel in self.wheels]
        for name in names:
            if not name or name == "gyro":
                raise ConfigError("wheels", f"{name!r} cannot be the name of a wheel")
            if names.count(name) > 1:
                raise ConfigError("wheels", f"two wheels are called {name!r}")

    def _choose_measured(self, measured: str | Sequence[str] | None) -> tuple[tuple[str, ...], bool]:
        if measured is None:
            return self.wheel_names, False
        chosen = (measured,) if isinstance(measured, str) else row_of(measured)
        if chosen is None or not all(isinstance(name, str) for name in chosen):
            raise ConfigError("measured", f"{shown(measured)}, must be a wheel's name, or a list of names")
        for name in chosen:
            if name != "gyro" and name not in self.wheel_names:
                raise ConfigError("measured", f"{name!r}, {did_you_mean(name, (*self.wheel_names, 'gyro'))}")
        if len(set(chosen)) < len(chosen):
            raise ConfigError("measured", f"{list(chosen)}, names a wheel twice")
        return tuple(name for name in chosen if name != "gyro"), "gyro" in chosen

    def _constraint_rows(self, skid_x: float | None) -> list[Row]:
        rows = [sideways(wheel) for wheel in self._speaking if wheel.kind is WheelKind.FIXED]
        skids = [wheel.x for wheel in self._speaking if wheel.kind is WheelKind.SKID]
        if skids:
            rows.append((0.0, 1.0, sum(skids) / len(skids) if skid_x is None else skid_x))
        return rows

    def _observed_rows(self) -> list[Row]:
        """Every measured row, steered wheels turned to an angle at which nothing lines up."""
        rows: list[Row] = []
        for wheel in self._measured:
            rows += contact(wheel) if wheel.kind is WheelKind.STEERED else [rolling(wheel)]
        for wheel in self._steered:
            if wheel.name not in self.measured_names:
                x, y = contact(wheel)
                c, s = math.cos(nominal(wheel.heading) + 0.3), math.sin(nominal(wheel.heading) + 0.3)
                rows.append((c * y[0] - s * x[0], c * y[1] - s * x[1], c * y[2] - s * x[2]))
        return [*rows, (0.0, 0.0, 1.0)] if self.gyro else rows

    def _solver_for(self, gyro: bool) -> Solver:
        """The solver with or without the gyro's row (a gyro can fall silent)."""
        if gyro not in self._solvers:
            steering = {name: index for index, name in enumerate(self.steered_names)}
            fixed, driving = [], []
            for index, wheel in enumerate(self._measured):
                if wheel.name in steering:
                    driving.append(
                        Driving(contact(wheel), index, wheel.radius, steering[wheel.name], wheel.heading)
                    )
                else:
                    fixed.append(Rolling(rolling(wheel), index, wheel.radius))
            leaning = [
                Leaning(contact(wheel), steering[wheel.name], wheel.heading)
                for wheel in self._steered
                if wheel.name not in self.measured_names
            ]
            if gyro != self.gyro:
                self._check_without_gyro()
            self._solvers[gyro] = Solver(
                rolling=fixed,
                driving=driving,
                leaning=leaning,
                gyro=gyro,
                constraints=self._constraints,
                null=self._null,
                scale=self._scale,
            )
        return self._solvers[gyro]

    # --- description ------------------------------------------------------------------------

    def wheel(self, name: str) -> Wheel:
        """The wheel of that name.

        Raises:
            InputError: If there is none; the message names the nearest.
        """
        for wheel in self.wheels:
            if wheel.name == name:
                return wheel
        raise InputError(f"no wheel {name!r}; {did_you_mean(name, [wheel.name for wheel in self.wheels])}")

    @property
    def constraints(self) -> tuple[Row, ...]:
        """Independent rows that hold exactly, unless wheels slip sideways."""
        return self._constraints

    @property
    def free_motions(self) -> tuple[tuple[float, ...], ...]:
        """Body twists that span all which the constraints allow."""
        return tuple(tuple(column) for column in self._null)

    def without(self, names: Sequence[str]) -> Kinematics:
        """The same wheels, of which these are not measured.

        Raises:
            ConfigError: If the others can never determine the motion.
        """
        left = [name for name in self.measured_names if name not in names]
        return Kinematics(
            self.wheels, measured=[*left, *(("gyro",) if self.gyro else ())], skid_x=self._skid_x
        )

    def __repr__(self) -> str:
        name = type(self).__name__
        given = {key: value for key, value in getattr(self, "parameters", {}).items() if value is not None}
        text = f"{name}({', '.join(f'{key}={value!r}' for key, value in given.items())})"
        return text if given and len(text) <= _LONGEST_REPR else f"<{name}: {', '.join(self.wheel_names)}>"

    # --- twist to wheels --------------------------------------------------------------------

    def inverse(self, twist: Twist2D, steering: Sequence[float] | None = None) -> WheelCommand:
        """Wheel speeds and steering angles that produce a body twist.

        Each steered wheel points along the velocity of its own contact point, turned by the shorter
        way from where it points now (driving backwards where that is nearer); a wheel whose contact
        stands still keeps its angle.

        Args:
            twist: Body twist (vx, vy, omega) of the reference point [m/s, m/s, rad/s].
            steering: Present steering angles [rad], in `steered_names` order; None means all zero.

        Returns:
            Speeds [rad/s] in `wheel_names` order, angles [rad] in `steered_names` order.

        Raises:
            Infeasible: If wheels would have to slip or steer beyond their range; `project` gives
                the nearest twist that they need not slip for.
            InputError: If the twist is not finite.
            ShapeError: If `steering` has the wrong length.
        """
        try:
            vx, vy, omega = twist.vx, twist.vy, twist.omega
            finite = math.isfinite(vx + vy + omega)
        except (AttributeError, TypeError):
            raise InputError(f"inverse: {twist!r}, must be a Twist2D of numbers") from None
        if not finite:
            raise InputError(f"{twist}: every component must be finite")
        for a, b, turn in self._constraints:
            slip = a * vx + b * vy + turn * omega
            if slip and abs(slip) > _FEASIBLE * (abs(vx) + abs(vy) + abs(omega) * self._scale):
                raise Infeasible(self._why_infeasible(twist))
        if not self._steered:
            return WheelCommand(tuple([a * vx + b * vy + c * omega for a, b, c, _ in self._plan]))
        return self._inverse_steered(vx, vy, omega, steering)

    def _inverse_steered(
        self, vx: float, vy: float, omega: float, steering: Sequence[float] | None
    ) -> WheelCommand:
        now = self._standstill if steering is None else steering
        if len(now) != len(self._steered):
            raise ShapeError(f"steering: {len(now)} given, must be {len(self._steered)} {self.steered_names}")
        speeds: list[float] = []
        angles: list[float] = []
        still = _STANDSTILL * (abs(vx) + abs(vy) + abs(omega) * self._reach)
        for a, b, c, aim in self._plan:
            if aim is None:
                speeds.append(a * vx + b * vy + c * omega)
                continue
            x, y, heading, radius, wheel = aim
            angle = now[len(angles)]
            ux, uy = vx - omega * y, vy + omega * x
            speed = hypot(ux, uy)
            if speed <= still:  # what is left here is rounding, and its direction is anything
                speed = 0.0
            else:
                change = atan2(uy, ux) - heading - angle
                if not -_QUARTER <= change <= _QUARTER:
                    change = remainder(change, tau)
                    if change > _QUARTER:
                        change, speed = change - pi, -speed
                    elif change < -_QUARTER:
                        change, speed = change + pi, -speed
                angle += change
                if wheel is not None:
                    angle, speed = _within(wheel, angle, speed)
            angles.append(angle)
            speeds.append(speed / radius)
        return WheelCommand(tuple(speeds), tuple(angles))

    def project(self, twist: Twist2D) -> Twist2D:
        """The feasible twist that keeps what the drive is free to choose, and mends the rest.

        A differential drive keeps vx and omega and gives up vy; a car whose reference point is
        ahead of its rear axle gets the vy that this point has in the turn.

        Args:
            twist: Any body twist of the reference point.

        Raises:
            InputError: If it is no twist.
        """
        require_type("project", "twist", twist, Twist2D)
        wanted = (twist.vx, twist.vy, twist.omega)
        null = self._null
        # In echelon form each column has a component that is 1 there and 0 in all others.
        free = [
            next(i for i in range(3) if column[i] == 1.0 and all(o is column or o[i] == 0.0 for o in null))
            for column in null
        ]
        return Twist2D(
            *(sum(wanted[k] * column[i] for k, column in zip(free, null, strict=True)) for i in range(3))
        )

    def _why_infeasible(self, twist: Twist2D) -> str:
        row, slip = max(
            (
                (row, row[0] * twist.vx + row[1] * twist.vy + row[2] * twist.omega)
                for row in self._constraints
            ),
            key=lambda pair: abs(pair[1]),
        )
        way = "sideways" if abs(row[1]) > 0.99 else "forward" if abs(row[0]) > 0.99 else "like this"
        nearest = self.project(twist)
        return (
            f"{type(self).__name__} cannot move {way}: (vx, vy, omega) = "
            f"({twist.vx:g}, {twist.vy:g}, {twist.omega:g}) would make its wheels slip by "
            f"{abs(slip):.3g} m/s. "
            f"Without slip: project(twist) = ({nearest.vx:g}, {nearest.vy:g}, {nearest.omega:g})"
        )

    def inverse_batch(self, twists: Array, steering: Array | None = None) -> tuple[Array, Array]:
        """`inverse` for many twists at once, on any array library.

        Args:
            twists: Body twists, shape (..., 3).
            steering: Present steering angles, shape (..., steered), or None for all zero.

        Returns:
            Speeds [rad/s], shape (..., wheels), and steering angles [rad], shape (..., steered).

        Raises:
            Infeasible: If any of the twists needs slip.
            ShapeError: If the last axis is not 3.
        """
        from array_api_compat import device

        xp = array_library("twists", twists)
        if twists.ndim == 0 or twists.shape[-1] != 3:
            raise ShapeError(f"twists: shape {tuple(twists.shape)}, the last axis must be 3: (vx, vy, omega)")
        vx, vy, omega = twists[..., 0], twists[..., 1], twists[..., 2]
        size = xp.abs(vx) + xp.abs(vy) + xp.abs(omega) * self._scale
        for a, b, turn in self._constraints:
            slip = xp.abs(a * vx + b * vy + turn * omega)
            if surely(xp.any(slip > _FEASIBLE * size)):
                worst = int(xp.argmax(xp.reshape(slip, (-1,))))
                flat = xp.reshape(twists, (-1, 3))
                raise Infeasible(
                    f"twist {worst}: " + self._why_infeasible(Twist2D(*(float(v) for v in flat[worst])))
                )
        speeds: list[Array] = []
        angles: list[Array] = []
        for wheel, (a, b, c, aim) in zip(self._speaking, self._plan, strict=True):
            if aim is None:
                speeds.append(a * vx + b * vy + c * omega)
                continue
            now = xp.zeros_like(vx) if steering is None else steering[..., len(angles)]
            angle, speed = _aim(xp, wheel, vx, vy, omega, now, self._reach)
            angles.append(angle)
            speeds.append(speed / wheel.radius)
        nothing = xp.zeros((*vx.shape, 0), dtype=vx.dtype, device=device(vx))
        return xp.stack(speeds, axis=-1), xp.stack(angles, axis=-1) if angles else nothing

    # --- wheels to twist --------------------------------------------------------------------

    @overload
    def forward(self, speeds: WheelCommand, *, yaw_rate: float | None = None) -> Twist2D: ...
    @overload
    def forward(
        self, speeds: Sequence[float], steering: Sequence[float] = (), *, yaw_rate: float | None = None
    ) -> Twist2D: ...
    def forward(
        self,
        speeds: Sequence[float] | WheelCommand,
        steering: Sequence[float] = (),
        *,
        yaw_rate: float | None = None,
    ) -> Twist2D:
        """Body twist that explains wheel readings best.

        It is linear in the readings: give it increments [rad] for speeds and it returns the
        displacement over the step.

        Args:
            speeds: Wheel speeds [rad/s], in `measured_names` order; or a WheelCommand, from which
                the measured wheels and their angles are taken.
            steering: Steering angles [rad], in `steered_names` order.
            yaw_rate: The gyro's yaw rate [rad/s], for drives that declare one; None where it is
                silent just now.

        Raises:
            ShapeError: If a sequence has the wrong length.
            InputError: If a number is not finite.
            Unobservable: If at these angles the readings do not determine the motion.
        """
        if isinstance(speeds, WheelCommand):
            steering = speeds.steering
            speeds = self.select(speeds.speeds)
        return Twist2D(*self._solve(speeds, steering, yaw_rate))

    def _solve(
        self, speeds: Sequence[float], steering: Sequence[float], yaw_rate: float | None
    ) -> list[float]:
        try:
            angles = self._check_reading(speeds, steering)
            twist = self._solver(yaw_rate).solve(speeds, angles, yaw_rate, math)
        except (TypeError, KeyError):
            rows = {"speeds": speeds, "steering": steering}
            require_numbers("forward", one={"yaw_rate": yaw_rate}, row=rows)
            raise
        if not math.isfinite(twist[0] + twist[1] + twist[2]):
            raise InputError(
                f"speeds {tuple(speeds)}, steering {tuple(angles)}, yaw_rate {yaw_rate}: must be finite"
            )
        return twist

    def select(self, speeds: Sequence[float]) -> list[float]:
        """Of one value per wheel (`wheel_names`) those of the measured wheels (`measured_names`).

        Raises:
            ShapeError: If there is not one value per wheel.
        """
        if len(speeds) != len(self.wheel_names):
            raise ShapeError(
                f"speeds: {len(speeds)} given, must be {len(self.wheel_names)} {self.wheel_names}"
            )
        values = dict(zip(self.wheel_names, speeds, strict=True))
        return [values[name] for name in self.measured_names]

    def forward_batch(
        self, speeds: Array, steering: Array | None = None, *, yaw_rate: Array | None = None
    ) -> Array:
        """`forward` for many readings at once, on any array library.

        Args:
            speeds: Wheel speeds [rad/s], shape (..., measured).
            steering: Steering angles [rad], shape (..., steered), or None where nothing steers.
            yaw_rate: The gyro's, shape (...), or None.

        Returns:
            Body twists, shape (..., 3). Readings that are not finite give twists that are not.

        Raises:
            ShapeError: If a last axis has the wrong length.
            Unobservable: If any reading does not determine the motion.
        """
        from array_api_compat import device

        xp = array_library("speeds", speeds)
        wheels, angles = self._columns(speeds, steering)
        twist = self._solver(yaw_rate).solve(wheels, angles, yaw_rate, xp)
        like = xp.zeros(speeds.shape[:-1], dtype=speeds.dtype, device=device(speeds))
        return xp.stack([like + part for part in twist], axis=-1)

    def residual(
        self,
        speeds: Sequence[float],
        steering: Sequence[float] = (),
        *,
        yaw_rate: float | None = None,
        lateral_slip: float = 1.0,
    ) -> tuple[float, ...]:
        """What no single body twist can explain: large residuals mean slip, or a wrong description.

        Args:
            speeds: Wheel speeds [rad/s], in `measured_names` order.
            steering: Steering angles [rad], in `steered_names` order.
            yaw_rate: The gyro's yaw rate [rad/s], where there is one.
            lateral_slip: How far "no sideways slip" may be off, as a multiple of what rolling may
                be off; 0 makes it exact.

        Returns:
            `z - A xi` per row of `residual_names` [m/s; rad/s for the gyro].

        Raises:
            As `forward`.
        """
        try:
            angles = self._check_reading(speeds, steering)
            left = tuple(self._solver(yaw_rate).residual(speeds, angles, yaw_rate, math, lateral_slip))
        except (TypeError, KeyError):
            numbers = {"yaw_rate": yaw_rate, "lateral_slip": lateral_slip}
            require_numbers("residual", one=numbers, row={"speeds": speeds, "steering": steering})
            raise
        if not math.isfinite(sum(left)):
            raise InputError(f"residual: speeds {shown(speeds)}, steering {shown(steering)}: must be finite")
        return left

    @property
    def residual_names(self) -> tuple[str, ...]:
        """Names of the rows of `residual`, in its order."""
        return (
            *(f"{name} rolling" for name in self.measured_names),
            *(f"{name} sideways" for name in self.steered_names),
            *(f"constraint {index + 1}" for index in range(len(self._constraints))),
            *(("gyro",) if self.gyro else ()),
        )

    @property
    def redundancy(self) -> int:
        """Degrees of freedom of the residual: how many rows could be spared."""
        rows = len(self.measured_names) + len(self.steered_names) + self.gyro
        return rows + len(self._constraints) - 3

    def gains(self, steering: Sequence[float] = (), trig: Any = math, *, gyro: bool | None = None) -> Gains:
        """How errors of the single rows become errors of the twist, at these steering angles.

        Args:
            steering: Angles [rad], one float or array per steered wheel.
            trig: `math`, or the namespace of the arrays.
            gyro: Whether the gyro takes part; None means if there is one.
        """
        angles = self._check_steering(steering)
        return self._solver_for(self.gyro if gyro is None else gyro).gains(angles, trig)

    def displacement(
        self, turned: Sequence[Any], steering: Sequence[Any] = (), turn: Any = None, trig: Any = math
    ) -> Sequence[Any]:
        """Body displacement (x, y, theta) over a step, from what the wheels turned in it. Checks nothing.

        Args:
            turned: Wheel angles [rad], one float or array per measured wheel.
            steering: Mid-step steering angles [rad], one per steered wheel.
            turn: What the gyro turned [rad], or None.
            trig: `math`, or the namespace of the arrays.

        Raises:
            Unobservable: If at these angles the readings do not determine the motion.
        """
        if turn is None and self._columns_of_turned is not None:
            x = y = theta = 0.0
            for (a, b, c), angle in zip(self._columns_of_turned, turned):  # noqa: B905 - the hot path
                # Not `x += ...`: arrays and numbers with derivatives may take turns.
                x = x + a * angle
                y = y + b * angle
                theta = theta + c * angle
            return x, y, theta
        return self._solver_for(turn is not None).solve(turned, steering, turn, trig)

    @property
    def observable_without_gyro(self) -> bool:
        """Whether the wheels alone determine the motion."""
        try:
            self._solver_for(False)
        except InputError:
            return False
        return True

    def twist_covariance(
        self,
        rolling: float | Sequence[float],
        steering: Sequence[float] = (),
        *,
        sideways: float | Sequence[float] = 0.0,
        lateral_slip: float = 0.0,
        gyro: float = 0.0,
    ) -> tuple[tuple[float, ...], ...]:
        """Covariance of `forward`'s twist: K R K^T + J S J^T.

        Args:
            rolling: Standard deviation of the measured wheels' rolling speeds [m/s]; one for all,
                or one per measured wheel.
            steering: Steering angles [rad].
            sideways: The same for the sideways rows of steered wheels [m/s].
            lateral_slip: Standard deviation of sideways motion that the constraints deny [m/s].
            gyro: Standard deviation of the yaw rate [rad/s].

        Returns:
            Symmetric 3 x 3 matrix, order (vx, vy, omega).
        """
        gains = self.gains(steering)
        groups = (
            (gains.rolling, rolling, "rolling"),
            (gains.sideways, sideways, "sideways"),
            (gains.slip, lateral_slip, "lateral_slip"),
            (gains.gyro, gyro, "gyro"),
        )
        covariance = [[0.0] * 3 for _ in range(3)]
        for columns, sigmas, name in groups:
            each = [sigmas] * len(columns) if isinstance(sigmas, float | int) else list(sigmas)
            if len(each) != len(columns):
                raise ShapeError(f"{name}: {len(each)} given, must be one or {len(columns)}")
            for column, sigma in zip(columns, each, strict=True):
                for i in range(3):
                    for j in range(3):
                        covariance[i][j] += sigma * sigma * (column[i] * column[j])
        return tuple(tuple(row) for row in covariance)

    def jacobian(self, steering: Sequence[float] = ()) -> tuple[tuple[float, ...], ...]:
        """How the twist changes with each measured wheel speed: d(vx, vy, omega) / d(speed).

        Args:
            steering: Steering angles [rad].

        Returns:
            Matrix 3 x measured [m/s per rad/s; rad/s per rad/s].
        """
        try:
            columns = self.gains(steering).rolling
        except (TypeError, KeyError):
            require_numbers("jacobian", row={"steering": steering})
            raise
        pairs = list(zip(columns, self._measured, strict=True))
        return tuple(tuple(column[i] * wheel.radius for column, wheel in pairs) for i in range(3))

    def icr(self, twist: Twist2D) -> tuple[float, float]:
        """Instantaneous centre of rotation [m] in the body frame: the point that stands still.

        On a straight line it lies at infinity, to the side that a left turn would have it; at rest
        it is nowhere: (nan, nan).

        Raises:
            InputError: If it is no twist.
        """
        try:
            if twist.omega:
                return -twist.vy / twist.omega, twist.vx / twist.omega
            if not (twist.vx or twist.vy):
                return math.nan, math.nan
            return (-math.inf * twist.vy if twist.vy else 0.0, math.inf * twist.vx if twist.vx else 0.0)
        except (AttributeError, TypeError):
            raise InputError(f"icr: {shown(twist)}, must be a Twist2D of numbers") from None

    # --- what comes in ----------------------------------------------------------------------

    def _solver(self, yaw_rate: Any) -> Solver:
        if yaw_rate is not None and not self.gyro:
            raise InputError("yaw_rate given, but no gyro is declared; add 'gyro' to measured=")
        return self._solver_for(yaw_rate is not None)

    def _check_without_gyro(self) -> None:
        rows = [*self._constraints, *(row for row in self._observed_rows() if row != (0.0, 0.0, 1.0))]
        try:
            observability.check_observable(rows, [(wheel.x, wheel.y) for wheel in self._speaking])
        except ConfigError as error:
            raise InputError(f"without a yaw rate: {error.problem}") from None

    def _check_reading(self, speeds: Sequence[float], steering: Sequence[float]) -> Sequence[float]:
        if len(speeds) != len(self._measured):
            raise ShapeError(
                f"speeds: {len(speeds)} given, must be {len(self._measured)} {self.measured_names}"
            )
        return self._check_steering(steering)

    def _check_steering(self, steering: Sequence[float]) -> Sequence[float]:
        if len(steering) != len(self._steered):
            return self.expand_steering(steering)
        return steering

    def expand_steering(self, steering: Sequence[Any], trig: Any = math) -> Sequence[Any]:  # noqa: ARG002
        """One angle per steered wheel, from a shorter form that this drive understands.

        Raises:
            ShapeError: If this drive understands none of that length.
        """
        raise ShapeError(
            f"steering: {len(steering)} given, must be {len(self._steered)} {self.steered_names}"
        )

    def check_batch(self, readings: Array, steering: Array | None) -> None:
        """Raises ShapeError unless these are (..., measured) readings and (..., steered) angles."""
        self._columns(readings, steering)

    def _columns(self, speeds: Array, steering: Array | None) -> tuple[list[Array], Sequence[Array]]:
        count = len(self._measured)
        if speeds.ndim == 0 or speeds.shape[-1] != count:
            raise ShapeError(
                f"speeds: shape {tuple(speeds.shape)}, the last axis must be {count} {self.measured_names}"
            )
        if steering is not None:
            array_library("steering", steering)
            if steering.ndim == 0:
                raise ShapeError("steering: a single number, must be an array of shape (..., steered)")
        given = [] if steering is None else [steering[..., k] for k in range(steering.shape[-1])]
        if len(given) != len(self._steered):
            from array_api_compat import array_namespace

            given = list(self.expand_steering(given, array_namespace(speeds)))
        return [speeds[..., k] for k in range(count)], given


def _within(wheel: Wheel, angle: float, speed: float) -> tuple[float, float]:
    """The angle, or its opposite, that the wheel can reach."""
    least, greatest = wheel.steering_range or (-math.inf, math.inf)
    for turn, sign in ((0.0, 1.0), (math.pi, -1.0), (-math.pi, -1.0), (math.tau, 1.0), (-math.tau, 1.0)):
        if least <= angle + turn <= greatest:
            return angle + turn, sign * speed
    raise Infeasible(
        f"{wheel.name} would have to steer {math.degrees(angle):.1f} deg ({angle:.4g} rad), "
        f"its range is {math.degrees(least):.1f} to {math.degrees(greatest):.1f} deg"
    )


def _aim(
    xp: Any, wheel: Wheel, vx: Array, vy: Array, omega: Array, now: Array, reach: float
) -> tuple[Array, Array]:
    """Angle and speed [m/s] of one steered wheel; the array twin of `_inverse_steered`."""
    ux, uy = vx - omega * wheel.y, vy + omega * wheel.x
    speed = xp.hypot(ux, uy) if hasattr(xp, "hypot") else xp.sqrt(ux * ux + uy * uy)
    size = xp.abs(vx) + xp.abs(vy) + xp.abs(omega) * reach
    change = xp.atan2(uy, ux) - wheel.heading - now
    change = change - math.tau * xp.round(change / math.tau)
    back = xp.abs(change) > _QUARTER
    change = xp.where(back, change - math.pi * xp.sign(change), change)
    still = speed <= _STANDSTILL * size
    angle = xp.where(still, now, now + change)
    signed = xp.where(still, 0.0 * speed, xp.where(back, -speed, speed))
    if wheel.steering_range is not None:
        least, greatest = wheel.steering_range
        for turn in (math.pi, -math.pi):
            outside = (angle < least) | (angle > greatest)
            flip = outside & (angle + turn >= least) & (angle + turn <= greatest)
            angle, signed = xp.where(flip, angle + turn, angle), xp.where(flip, -signed, signed)
        for extreme in (float(xp.min(angle)), float(xp.max(angle))):
            _within(wheel, extreme, 1.0)
    return angle, signed
