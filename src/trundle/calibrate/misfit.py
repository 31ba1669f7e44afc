"""How badly wheels contradict each other and the witnesses, under an account of what they said.

Per window the twist that explains all rows best is found by least squares (DESIGN.md section 1, constraints
and witnesses as soft rows). What is left, in units of what may be off on a sound robot, is squared, averaged
over the degrees of freedom and over the windows: below 1 all is well, and one reversed wheel makes tens.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import numpy.typing as npt

from trundle.calibrate.wheel_steps import WheelSteps
from trundle.calibrate.witness import Label, Windows, Witness, lever_of
from trundle.robot import Kinematics, Robot, Wheel
from trundle.robot.rows import Row, contact, rolling

__all__ = ["Account", "Bench", "Fit"]

Floats = npt.NDArray[np.float64]
Mask = npt.NDArray[np.bool_]

WHEEL = 0.03
"""A sound wheel's way may be off by this share of the motion."""
SIDEWAYS = 0.05
"""And the body may slip sideways by this one."""
ASTRAY = 0.15
"""What a person calls straight, or on the spot."""
AMOUNT = 0.15
"""And how well a person measures."""
ROUGHNESS = 5e-4
"""What every way may be off by [m]."""
TAME = 10.0
"""Beyond this, what is left of a window counts by its logarithm: one glitch is no fault (Cauchy)."""
VANISHED = 1e3
"""What each window costs an account that silences most of them."""
LEAST = 5.0
"""A window tells something where its motion is so many times what may be off anyway."""


@dataclass(frozen=True, slots=True, eq=False)
class Account:
    """What wheels are taken to have said, and to be.

    Attributes:
        wheels: By name, in the drive's order.
        measured: Names of the wheels whose rotation is read.
        steered: Names of the steered wheels.
        constraints: Rows that hold exactly.
        turned: [rad], shape (steps, measured).
        steering: [rad], shape (steps, steered).
        gyro: What the gyro's turn is multiplied by.
        mirrored: Whether the reference saw the mirror image of the path.
        deaf: Per measured wheel the windows in which it is not listened to.
        unled: Steered wheels whose angle is not listened to.
    """

    wheels: Mapping[str, Wheel]
    measured: tuple[str, ...]
    steered: tuple[str, ...]
    constraints: tuple[Row, ...]
    turned: Floats
    steering: Floats
    gyro: float = 1.0
    mirrored: bool = False
    deaf: Mapping[str, Mask] = field(default_factory=dict)
    unled: tuple[str, ...] = ()

    @classmethod
    def of(cls, drive: Kinematics, steps: WheelSteps) -> Account:
        """What a log says of itself."""
        wheels = {wheel.name: wheel for wheel in drive.wheels if wheel.name in drive.wheel_names}
        names = drive.measured_names, drive.steered_names
        return cls(wheels, *names, drive.constraints, steps.turned, steps.steering)

    def on(self, drive: Kinematics) -> Account:
        """The same readings, on other wheels of the same names."""
        wheels = {wheel.name: wheel for wheel in drive.wheels if wheel.name in drive.wheel_names}
        return replace(self, wheels=wheels, constraints=drive.constraints)

    def scaled(self, names: Sequence[str], factor: float) -> Account:
        """These wheels turned so many times what they said."""
        turned = self.turned.copy()
        for name in names:
            turned[:, self.measured.index(name)] *= factor
        return replace(self, turned=turned)

    def steered_by(self, names: Sequence[str], factor: float) -> Account:
        """These wheels were steered by so many times what they said."""
        steering = self.steering.copy()
        for name in names:
            steering[:, self.steered.index(name)] *= factor
        return replace(self, steering=steering)

    def exchanged(
        self, pairs: Sequence[tuple[str, str]], *, turned: bool = True, steering: bool = False
    ) -> Account:
        """Each of a pair said what the other did."""
        account = self
        for one, other in pairs:
            if turned:
                account = replace(account, turned=_swapped(account.turned, self.measured, one, other))
            if steering:
                account = replace(account, steering=_swapped(account.steering, self.steered, one, other))
        return account


def _swapped(columns: Floats, names: tuple[str, ...], one: str, other: str) -> Floats:
    a, b = names.index(one), names.index(other)
    swapped = columns.copy()
    swapped[:, a], swapped[:, b] = columns[:, b], columns[:, a]
    return swapped


@dataclass(frozen=True, slots=True, eq=False)
class Fit:
    """How an account does.

    Attributes:
        score: 0 to about 50; up to 1 is what a sound robot shows.
        moved: Displacement of each window that explains its rows best, shape (windows, 3).
        each: What each window adds to the score, shape (windows,).
    """

    score: float
    moved: Floats
    each: Floats


class Bench:
    """Where accounts of one log are tried.

    Args:
        robot: As described.
        windows: Spans of the log.
        witnesses: Who else speaks.
        label: What a person says.
        share: How much of the log's motion the windows hold.
    """

    def __init__(
        self,
        robot: Robot,
        windows: Windows,
        witnesses: Sequence[Witness],
        label: Label | None,
        share: float = 1.0,
    ) -> None:
        drive = robot.measuring
        self.robot = robot
        self.windows = windows
        self.witnesses = tuple(witnesses)
        self.label = label
        self.share = share
        self.lever = lever_of(drive)
        self.ticks = {
            name: abs(robot.encoders[name].radians_per_tick) if name in robot.encoders else 0.0
            for name in drive.measured_names
        }
        self.spread = robot.noise.wheel_distance
        self._car = bool(drive.constraints) and bool(drive.steered_names)
        self._spoken = sum(int(np.isfinite(one.moved).any(axis=0).sum()) for one in witnesses)

    def freedom(self, account: Account) -> int:
        """How many rows could be spared; with 0 there is nothing to contradict."""
        rows = len(account.measured) + len(account.steered) + len(account.constraints) + self._spoken
        if self.label is not None:
            rows += 1 + (not self._car)
        return rows - 3

    def thinned(self, moving: Mask, most: int) -> tuple[Bench, Mask]:
        """The same with only so many of the windows that tell something, spread evenly."""
        kept = np.flatnonzero(moving)
        kept = kept[np.linspace(0, len(kept) - 1, min(most, len(kept))).astype(np.int64)]
        windows = replace(self.windows, chosen=self.windows.chosen[kept])
        witnesses = [
            replace(one, moved=one.moved[kept], absolute=one.absolute[kept]) for one in self.witnesses
        ]
        share = self.share * len(kept) / max(1, int(moving.sum()))
        return Bench(self.robot, windows, witnesses, self.label, share), np.ones(len(kept), dtype=bool)

    def moving(self, account: Account, least: float = LEAST) -> Mask:
        """The windows that tell something: whose motion is so many times what may be off anyway."""
        ways = self.ways(account)
        size = np.max(np.abs(np.column_stack([*ways.values(), self._witnessed(account)])), axis=1)
        anyway = max((self.ticks[name] * account.wheels[name].radius for name in ways), default=0.0)
        moving: Mask = size > least * (ROUGHNESS + anyway)
        return moving

    def fit(self, account: Account, moving: Mask) -> Fit:
        """Try an account on the windows that tell something."""
        ways = self.ways(account)
        told = self._witnessed(account)
        size = np.maximum(np.median(np.abs(np.column_stack(list(ways.values()))), axis=1), told)
        rows, values, sigmas = self._stack(account, ways, size)
        moved, left = _least_squares(rows, values, sigmas)
        if self.label is not None:
            left = left + self._wrong_way(moved, size)
        # A factor that makes the motion vanish explains nothing.
        loud = moving & self.moving(account, 0.5 * LEAST)
        if 2 * int(loud.sum()) < int(moving.sum()):
            left = np.full_like(left, VANISHED)
        each = left / max(1, self.freedom(account))
        each = TAME * np.log1p(each / TAME)
        score = float(each[moving].mean()) if moving.any() else 0.0
        moved[:, 2] /= self.lever
        return Fit(score + self._wrong_amount(moved), moved, each)

    # --- rows ---------------------------------------------------------------------------------

    def ways(self, account: Account) -> dict[str, Floats]:
        """What each measured wheel rolled in each window [m]."""
        turned = self.windows.sums(account.turned)
        return {name: turned[:, k] * account.wheels[name].radius for k, name in enumerate(account.measured)}

    def expected(self, account: Account, moved: Floats) -> dict[str, Floats]:
        """What each measured wheel should have rolled in windows with these displacements [m]."""
        vx, vy, turn = moved.T
        ways = {}
        for name in account.measured:
            wheel = account.wheels[name]
            if name in account.steered:
                toward = wheel.heading + account.steering[:, account.steered.index(name)]
                aim = self.windows.means(np.stack([np.cos(toward), np.sin(toward)], axis=-1))
                ways[name] = aim[:, 0] * (vx - turn * wheel.y) + aim[:, 1] * (vy + turn * wheel.x)
            else:
                a, b, c = rolling(wheel)
                ways[name] = a * vx + b * vy + c * turn
        return ways

    def alone(self) -> Bench:
        """The same without anybody beside the wheels."""
        return Bench(self.robot, self.windows, (), None, self.share)

    def _witnessed(self, account: Account) -> Floats:
        """How far the witnesses say that the robot moved, turns by the lever [m]."""
        size = np.zeros(len(self.windows.chosen))
        for witness in self.witnesses:
            moved = np.nan_to_num(self._said(witness, account))
            length = np.sqrt(moved[:, 0] ** 2 + moved[:, 1] ** 2 + (self.lever * moved[:, 2]) ** 2)
            size = np.maximum(size, length)
        return size

    def _said(self, witness: Witness, account: Account) -> Floats:
        if witness.name == "gyro":
            return witness.moved * account.gyro
        if witness.name == "reference" and account.mirrored:
            return witness.moved * (1.0, -1.0, -1.0)
        return witness.moved

    def _stack(
        self, account: Account, ways: Mapping[str, Floats], size: Floats
    ) -> tuple[Floats, Floats, Floats]:
        """Rows (windows, rows, 3) in metres, what they read, and how far each may be off."""
        table = _Table(len(size), self.lever)
        for name, way in ways.items():
            self._add_wheel(table, account, name, way, size)
        for name in account.steered:
            if name not in account.measured and name not in account.unled:
                table.add(self._leaning(account, name), 0.0 * size, SIDEWAYS * size + ROUGHNESS)
        for row in account.constraints:
            table.add(row, 0.0 * size, SIDEWAYS * size + ROUGHNESS)
        for witness in self.witnesses:
            said = self._said(witness, account)
            off = np.hypot(witness.relative * said, witness.absolute)
            for k, unit in enumerate(((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, self.lever))):
                scale = unit[k]
                table.add(unit, scale * said[:, k], scale * off[:, k] + WHEEL * size + ROUGHNESS)
        if self.label is not None:
            self._add_label(table, self.label, size)
        return table.stacked()

    def _add_wheel(self, table: _Table, account: Account, name: str, way: Floats, size: Floats) -> None:
        wheel = account.wheels[name]
        tick = self.ticks[name] * wheel.radius
        length = np.maximum(np.abs(way), size)
        off = np.sqrt((WHEEL * length) ** 2 + self.spread**2 * length + tick**2 / 6.0) + ROUGHNESS
        if name in account.deaf:
            off = np.where(account.deaf[name], np.inf, off)
        if name not in account.steered:
            table.add(rolling(wheel), way, off)
        elif name not in account.unled:
            toward = wheel.heading + account.steering[:, account.steered.index(name)]
            rolled = account.turned[:, account.measured.index(name)] * wheel.radius
            parts = self.windows.sums(np.stack([rolled * np.cos(toward), rolled * np.sin(toward)], axis=-1))
            for k, row in enumerate(contact(wheel)):
                table.add(row, parts[:, k], off)

    def _leaning(self, account: Account, name: str) -> Floats:
        """The sideways row of a steered wheel whose rotation is not read, window by window."""
        wheel = account.wheels[name]
        toward = wheel.heading + account.steering[:, account.steered.index(name)]
        aim = self.windows.means(np.stack([np.cos(toward), np.sin(toward)], axis=-1))
        x, y = (np.array(row) for row in contact(wheel))
        leaning: Floats = aim[:, :1] * y - aim[:, 1:] * x
        return leaning

    # --- what a person says -------------------------------------------------------------------

    def _add_label(self, table: _Table, label: Label, size: Floats) -> None:
        component, _ = label.drove.direction
        units = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, self.lever))
        for k, unit in enumerate(units):
            if k != component and not (self._car and component == 2):
                table.add(unit, 0.0 * size, ASTRAY * size + 2.0 * ROUGHNESS)

    def _wrong_way(self, moved: Floats, size: Floats) -> Floats:
        """Squares of motion against what the person said."""
        assert self.label is not None
        component, sign = self.label.drove.direction
        off = WHEEL * size + ROUGHNESS
        left = (np.minimum(0.0, sign * moved[:, component]) / off) ** 2
        if self._car and component == 2:
            left = left + (np.minimum(0.0, moved[:, 0]) / off) ** 2
        return np.asarray(left)

    def _wrong_amount(self, moved: Floats) -> float:
        if self.label is None or self.label.amount is None:
            return 0.0
        component, sign = self.label.drove.direction
        total = sign * float(moved[:, component].sum()) / self.share
        worst = max(abs(total), self.label.amount)
        excess = ((total - self.label.amount) / (AMOUNT * worst)) ** 2
        return float(TAME * np.log1p(excess / TAME))


class _Table:
    """Rows under construction; the last component is a length: an angle times the lever."""

    def __init__(self, count: int, lever: float) -> None:
        self.count = count
        self.lever = lever
        self.rows: list[Floats] = []
        self.values: list[Floats] = []
        self.sigmas: list[Floats] = []

    def add(self, row: Any, value: Floats, sigma: Floats) -> None:
        """One row, the same in all windows or one for each. NaN in a value: it is silent there."""
        known = np.isfinite(value)
        scaled = np.array(row, dtype=np.float64) / (1.0, 1.0, self.lever)
        self.rows.append(np.broadcast_to(scaled, (self.count, 3)))
        self.values.append(np.where(known, value, 0.0))
        self.sigmas.append(np.where(known, sigma, np.inf))

    def stacked(self) -> tuple[Floats, Floats, Floats]:
        """(windows, rows, 3), (windows, rows), (windows, rows)."""
        return np.stack(self.rows, axis=1), np.stack(self.values, axis=1), np.stack(self.sigmas, axis=1)


def _least_squares(rows: Floats, values: Floats, sigmas: Floats) -> tuple[Floats, Floats]:
    """Per window the best unknowns and the weighted squares that are left. What is open stays zero."""
    weighted = rows / sigmas[..., np.newaxis]
    wanted = values / sigmas
    normal = np.einsum("wri,wrj->wij", weighted, weighted)
    trace = np.trace(normal, axis1=1, axis2=2)
    normal += (1e-10 * trace + 1e-300)[:, np.newaxis, np.newaxis] * np.eye(3)
    right = np.einsum("wri,wr->wi", weighted, wanted)
    found = np.linalg.solve(normal, right[..., np.newaxis])[..., 0]
    rest = wanted - np.einsum("wri,wi->wr", weighted, found)
    return found, np.einsum("wr,wr->w", rest, rest)
