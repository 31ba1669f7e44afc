"""The files that a calibration becomes: descriptions to drive by, pictures to look at."""

from __future__ import annotations

import importlib.util
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

from trundle.apps.output_file import check_output, write_text
from trundle.errors import InputError, MissingExtra

if TYPE_CHECKING:
    from trundle.calibrate.calibration import Calibration
    from trundle.calibrate.hold_out import HoldOut
    from trundle.robot import Robot

__all__ = ["CalibrationFiles"]


class _Result(NamedTuple):
    """What files are made of.

    Attributes:
        described: File of the description that it began with.
        found: The calibration.
        judged: What held-out runs say of it.
        robot: The robot as it is written down.
    """

    described: Path
    found: Calibration
    judged: HoldOut | None
    robot: Robot


class CalibrationFiles:
    """What was asked for on the command line.

    Args:
        **paths: By kind: `robot`, `picture`, `report`, `ros2`, `myconfig`, `wpilib`; None where not wanted.
    """

    def __init__(self, **paths: Path | None) -> None:
        self._paths = {kind: path for kind, path in paths.items() if path is not None}

    def check(self, inputs: Sequence[Path], *, force: bool) -> None:
        """Refuse what could not be written in the end.

        Raises:
            InputError: If a suffix is another one, a file exists and `force` is not given, or two are one.
            OutputError: If a folder does not exist.
            MissingExtra: If a package is not installed.
        """
        for kind, path in self._paths.items():
            check_output(path, suffixes=_KINDS[kind].suffixes, inputs=inputs, force=force)
            if [one.absolute() for one in self._paths.values()].count(path.absolute()) > 1:
                raise InputError(f"{path}: cannot be two outputs at once")
        needed = {"scipy": "calibrate"}
        if {"picture", "report"} & set(self._paths):
            needed["matplotlib"] = "plot"
        for package, extra in needed.items():
            if importlib.util.find_spec(package) is None:
                raise MissingExtra(package, extra)

    def try_out(self, robot: Robot) -> None:
        """Refuse what has no words for such a robot, before the work is done.

        Raises:
            InputError: If another program knows no such drive.
        """
        for kind, path in self._paths.items():
            if kind in _TEXTS:
                _TEXTS[kind](path, robot, robot)

    def write(self, described: Path, found: Calibration, judged: HoldOut | None, *, trusted: bool) -> None:
        """Write pictures in any case, and numbers that robots drive by where they are trusted."""
        from trundle.apps.calibrated_robot import calibrated_robot

        result = _Result(described, found, judged, calibrated_robot(found))
        for kind in self._kinds(trusted=trusted):
            _KINDS[kind].write(self._paths[kind], result)

    def unsaid(self, found: Calibration, *, trusted: bool) -> list[str]:
        """What a file could not say of the numbers, as sentences."""
        from trundle.adapters.myconfig import unsaid_in_myconfig
        from trundle.apps.calibrated_robot import calibrated_robot

        if "myconfig" not in self._kinds(trusted=trusted):
            return []
        return [
            f"{self._paths['myconfig']}: {words}" for words in unsaid_in_myconfig(calibrated_robot(found))
        ]

    def written(self, *, trusted: bool) -> list[tuple[str, str]]:
        """Kind and path of each file."""
        return [(kind, str(self._paths[kind])) for kind in self._kinds(trusted=trusted)]

    def refused(self, *, trusted: bool) -> list[str]:
        """Paths that were asked for and not written."""
        return [str(path) for kind, path in self._paths.items() if kind not in self._kinds(trusted=trusted)]

    def _kinds(self, *, trusted: bool) -> list[str]:
        return [kind for kind in self._paths if trusted or not _KINDS[kind].driven_by]


def _write_robot(path: Path, result: _Result) -> None:
    from trundle.adapters.robot_yaml import save_robot
    from trundle.apps.calibrated_robot import margin_notes

    save_robot(result.robot, path, like=result.described, notes=margin_notes(result.found))


def _draw(path: Path, result: _Result) -> None:
    from trundle.apps.calibration_plot import plot_calibration
    from trundle.apps.plot import save_plot

    save_plot(plot_calibration(result.found, title=f"{result.robot.name}, calibrated"), path)


def _write_report(path: Path, result: _Result) -> None:
    from importlib.metadata import version

    from trundle.apps.calibration_report import report_page

    command = shlex.join(["trundle", *sys.argv[1:]])
    page = report_page(
        result.found, result.judged, title=result.robot.name, command=command, version=version("trundle")
    )
    write_text(path, page)


def _ros2_text(_path: Path, robot: Robot, nominal: Robot) -> str:
    from trundle.adapters.ros2_controllers import controllers_text

    return controllers_text(robot, nominal=nominal)


def _myconfig_text(_path: Path, robot: Robot, _nominal: Robot) -> str:
    from trundle.adapters.myconfig import myconfig_text

    return myconfig_text(robot)


def _wpilib_text(path: Path, robot: Robot, _nominal: Robot) -> str:
    from trundle.adapters.wpilib_constants import wpilib_text

    java = path.suffix.lower() == ".java"
    name = path.stem if java else "DriveConstants"  # Java wants the class to be called like its file
    return wpilib_text(robot, path.suffix.lower(), name=name)


# What other programs read: the text of a file for a robot, and for what it was before.
_TEXTS: Mapping[str, Callable[[Path, Robot, Robot], str]] = {
    "ros2": _ros2_text,
    "myconfig": _myconfig_text,
    "wpilib": _wpilib_text,
}


def _write_for(kind: str) -> Callable[[Path, _Result], None]:
    def write(path: Path, result: _Result) -> None:
        from trundle.adapters.robot_yaml import load_robot

        write_text(path, _TEXTS[kind](path, result.robot, load_robot(result.described)))

    return write


class _Kind(NamedTuple):
    """A kind of file.

    Attributes:
        suffixes: What its name may end in.
        write: Writes one.
        driven_by: Whether a robot will drive by its numbers.
    """

    suffixes: tuple[str, ...]
    write: Callable[[Path, _Result], None]
    driven_by: bool


_KINDS: Mapping[str, _Kind] = {
    "robot": _Kind((".yaml", ".yml"), _write_robot, driven_by=True),
    "ros2": _Kind((".yaml", ".yml"), _write_for("ros2"), driven_by=True),
    "myconfig": _Kind((".py",), _write_for("myconfig"), driven_by=True),
    "wpilib": _Kind((".java", ".py"), _write_for("wpilib"), driven_by=True),
    "picture": _Kind((".png", ".svg", ".pdf"), _draw, driven_by=False),
    "report": _Kind((".html",), _write_report, driven_by=False),
}
