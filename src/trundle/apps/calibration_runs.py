"""Logs and what the command line says of each, as runs to calibrate from."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from trundle.adapters.quantity import POSITION, read_number, read_quantity
from trundle.apps.rejection import left_out
from trundle.apps.run_labels import labels
from trundle.errors import InputError

if TYPE_CHECKING:
    from trundle.calibrate.run import Reference, Run
    from trundle.robot import Robot

__all__ = ["Drives", "require_different"]

GYRO = "gyro"


class Drives:
    """The logs of a command line, and what it says of them.

    Args:
        logs: Files.
        reference: Trajectories in place of the logs' own; `gyro` for the headings of the gyro.
        rolled: Distances straight on.
        spun: Turns on the spot.
        closed: Logs that end where and as they began.

    Raises:
        InputError: If a word is no distance or number, or one log is spoken of twice.
    """

    def __init__(
        self,
        logs: Sequence[Path],
        *,
        reference: Sequence[str] | None = None,
        rolled: Sequence[str] | None = None,
        spun: Sequence[str] | None = None,
        closed: Sequence[str] | None = None,
    ) -> None:
        self._logs = logs
        if list(reference or ()) == [GYRO]:  # each log has its own
            reference = [f"all={GYRO}"]
        self._files = labels("--reference", reference or (), logs, in_order=True)
        distances = labels("--rolled", rolled or (), logs, in_order=True)
        turns = labels("--spun", spun or (), logs, in_order=True)
        self._rolled = {k: _length(word) for k, word in distances.items()}
        self._spun = {k: _turns(word) for k, word in turns.items()}
        self._closed = set(labels("--closed", [f"{name}=" for name in closed or ()], logs))
        said = [*self._files, *self._rolled, *self._spun, *self._closed]
        if twice := [k for k in said if said.count(k) > 1]:
            options = "--reference, --rolled, --spun and --closed"
            raise InputError(f"{logs[twice[0]]}: {options} exclude each other, and two speak of it")

    @property
    def files(self) -> list[Path]:
        """Files of references that were given."""
        return [Path(word) for word in self._files.values() if word != GYRO]

    def run(self, number: int, robot: Robot, doing: Callable[[str], None], *, salvage: bool = False) -> Run:
        """Read a log.

        Raises:
            LogError: If it cannot be read.
            InputError: If nothing is known of where the robot went.
        """
        from trundle.adapters.log import read_log
        from trundle.calibrate.run import Run
        from trundle.records import Trajectory

        path = self._logs[number]
        doing(f"reading {path.name}")
        own = number not in {*self._files, *self._rolled, *self._spun, *self._closed}
        # What stands in for the log's own reference need not be in the log.
        mapping = robot.log if own else robot.log.without_reference()
        log = read_log(path, robot, mapping=mapping, salvage=salvage)
        reference = log.reference if own else self._reference(number)
        if self._files.get(number) == GYRO and log.yaw_rate is None:
            raise InputError(f"{path}: --reference gyro: the log holds no gyro (log.gyro in robot.yaml)")
        if reference is None and own:
            raise InputError(
                f"{path}: nothing is known of where the robot went: it needs log.reference in robot.yaml, "
                "--reference, --rolled, --spun or --closed"
            )
        gaps = (
            () if own or not isinstance(reference, Trajectory) else left_out(self._files[number], reference)
        )
        log = dataclasses.replace(log, reference=None, warnings=(*log.warnings, *gaps))
        return Run(log=log, reference=reference, name=path.stem)

    def _reference(self, number: int) -> Reference | None:
        from trundle.adapters.trajectory import read_trajectory
        from trundle.calibrate.run import Closed, Rolled, Spun

        if number in self._rolled:
            return Rolled(self._rolled[number])
        if number in self._spun:
            return Spun(math.tau * self._spun[number])
        if number in self._closed:
            return Closed()
        return None if self._files[number] == GYRO else read_trajectory(self._files[number])


def require_different(runs: Sequence[Run], logs: Sequence[Path]) -> None:
    """Refuse a drive that is given twice: it would count twice, and judge itself.

    Raises:
        InputError: If two logs hold the same readings at the same times.
    """
    known: dict[tuple[bytes, ...], Path] = {}
    for run, path in zip(runs, logs, strict=True):
        columns = (run.log.time_ns, run.log.wheels, run.log.twists)
        readings = tuple(b"" if column is None else column.tobytes() for column in columns)
        first = known.setdefault(readings, path)
        if first is not path:
            same = "is given twice" if first == path else f"is the same drive as {first}"
            raise InputError(f"{path}: {same}: it would count twice, and be judged by itself")


def _length(word: str) -> float:
    number = float(word) if _is_number(word) else word
    return read_quantity("--rolled", number, POSITION)


def _turns(word: str) -> float:
    return read_number("--spun", float(word) if _is_number(word) else word)


def _is_number(word: str) -> bool:
    try:
        float(word)
    except ValueError:
        return False
    return True
