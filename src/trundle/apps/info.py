"""`trundle info`: what is in a log."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from trundle.adapters.content import KINDS_OF_LOG
from trundle.apps.exit_code import ExitCode
from trundle.apps.progress import Progress
from trundle.apps.wording import aligned, counted, digits, labelled, plural, seconds, size

if TYPE_CHECKING:
    import numpy as np
    import numpy.typing as npt

    from trundle.adapters.bag import BagReader
    from trundle.adapters.table import Ending, Table
    from trundle.adapters.wpilog import WpilogFile
    from trundle.apps.log_proposal import Column, Proposal, Topic
    from trundle.robot import Robot

    Stamps = npt.NDArray[np.int64]

__all__ = ["info"]

_SKEW = 0.1  # [s]: stamps and receipt that agree less are worth a line
_OTHER_CLOCK = 86400.0  # [s]: what is off by more than a day does not tell the time of day at all
_LONGEST_TYPE = 45
_MEASURING = ("sensor_msgs", "nav_msgs", "geometry_msgs", "vesc_msgs")


def info(
    log: Annotated[Path, Parameter(help=f"{KINDS_OF_LOG}.")], /, *, robot: Path | None = None
) -> ExitCode:
    """Say what a log holds, and propose a log: section for robot.yaml.

    Args:
        log: Of any format that `read_log` knows.
        robot: A robot's description: the section is then written for its wheels, and its own is tried.
    """
    from trundle.adapters.content import Content, content_of
    from trundle.adapters.robot_yaml import load_robot

    described = None if robot is None else load_robot(robot)
    content = content_of(log)
    with Progress(1) as progress:
        progress.step(f"reading {log.name}")
        tables = (Content.TEXT, Content.PARQUET, Content.JSON, Content.NPZ, Content.TUB)
        kind = _TableReport if content in tables else _BagReport
        report = kind(log, content, described)
        tried = [] if described is None else _tried(log, described)
    for warning in report.warnings:
        print(f"trundle: warning: {warning}", file=sys.stderr)
    print(*report.lines, sep="\n")
    if tried:
        print("", f"{robot} reads it:", *tried, sep="\n")
    else:
        print(*_proposed(report.proposal), sep="\n")
    return ExitCode.PARTIAL if report.losses else ExitCode.FINE


def _proposed(proposal: Proposal) -> list[str]:
    from trundle.apps.log_proposal import section_text

    head = ["", "# A section for robot.yaml, guessed: check columns, units, kinds and signs."]
    if not {"wheels", "twist"} & set(proposal.section):
        head.append("# No column or topic looks like wheels: add wheels: or twist: by hand.")
    if "column" in str(proposal.section) and "time" not in proposal.section:
        head.append("# No column looks like time, without which nothing can be tracked: add time: by hand.")
    return [*head, *section_text(proposal.ordered)]


def _tried(log: Path, robot: Robot) -> list[str]:
    """What the robot's own section, if it has one, makes of the log; nothing where it does not fit."""
    from trundle.adapters.log import read_log
    from trundle.errors import TrundleError
    from trundle.robot import LogMapping

    try:
        wheels = read_log(log, robot, salvage=True, sort=True)
    except TrundleError as error:
        if robot.log != LogMapping():
            print(f"trundle: warning: the robot's own log: section does not fit: {error}", file=sys.stderr)
        return []
    read = "twists of the body"
    if wheels.wheels is not None:
        read = f"{wheels.reading.value} of {', '.join(wheels.wheel_names)}"
    reference = "" if wheels.reference is None else plural(len(wheels.reference), "pose")
    return labelled(
        [
            ("samples", f"{len(wheels)}, {_rhythm(wheels.time_ns)}"),
            ("readings", read),
            ("steering", ", ".join(wheels.steering_names)),
            ("gyro", "" if wheels.yaw_rate is None else "yaw rate"),
            ("reference", reference),
            ("rejected", counted(wheels.rejected)),
        ]
    )


def _headline(log: Path, words: str) -> str:
    files = [file for file in log.rglob("*") if file.is_file()] if log.is_dir() else [log]
    return f"{log}: {words}, {size(sum(file.stat().st_size for file in files))}"


def _rhythm(time_ns: Stamps) -> str:
    """`61.9 s at 30.0 Hz, longest step 0.1 s at 12.3 s, 2 stamps go back`."""
    import numpy as np

    steps = np.diff(time_ns) * 1e-9
    if not len(steps) or not (steps > 0.0).any():
        return "all at one time"
    usual = float(np.median(steps[steps > 0.0]))
    words = [f"{seconds(float(np.ptp(time_ns)) * 1e-9)} at {digits(1.0 / usual)} Hz"]
    longest = int(steps.argmax())
    if steps[longest] > 3.0 * usual:
        gaps = int((steps > 3.0 * usual).sum())
        at = seconds((time_ns[longest] - time_ns[0]) * 1e-9)
        words.append(f"{plural(gaps, 'gap')}, the longest {seconds(float(steps[longest]))} at {at}")
    back, repeated = int((steps < 0.0).sum()), int((steps == 0.0).sum())
    words += [f"{back} x back in time"] if back else []
    words += [f"{repeated} x the same time again"] if repeated else []
    return ", ".join(words)


class _TableReport:
    """Columns, and what they look like."""

    def __init__(self, log: Path, content: Any, robot: Robot | None) -> None:
        from trundle.adapters.content import Content
        from trundle.adapters.table import open_table
        from trundle.adapters.tub import Tub
        from trundle.apps.dialect import seeming_format
        from trundle.apps.log_proposal import propose_for_table
        from trundle.errors import LogError
        from trundle.robot.log_mapping import TableFormat

        self.warnings: list[str] = []
        self.losses: list[str] = []
        written = seeming_format(log) if content is Content.TEXT else TableFormat()
        columns, ending = _columns(Tub(log) if content is Content.TUB else open_table(log, written))
        if ending is not None:
            self.losses.append(ending.loss)
            self.warnings.append(ending.loss)
        if all(column.values is None for column in columns):
            raise LogError(log, "format", "is text, but no column of it holds numbers")
        measuring = None if robot is None else robot.measuring
        wheels = () if measuring is None else measuring.measured_names
        steered = () if measuring is None else measuring.steered_names
        self.proposal = propose_for_table(columns, written, wheels, steered)
        rows = max((len(c.values) + c.unreadable for c in columns if c.values is not None), default=0)
        self.lines = [_headline(log, f"{content.value}, {plural(rows, 'row')}")]
        self.lines += self._time(columns)
        table = [("column", "least", "greatest", "looks like")]
        table += [self._row(column) for column in columns]
        self.lines += ["", *aligned(table, right=(1, 2))]

    def _time(self, columns: list[Column]) -> list[str]:
        import numpy as np

        from trundle.robot.log_mapping import Unit

        time = self.proposal.section.get("time")
        if time is None:
            return ["  no column looks like time"]
        values = next(c.values for c in columns if c.name == time["column"])
        assert values is not None
        elapsed = (values - values[0]) * (Unit(time["unit"]).factor * 1e9)
        return [f"  {_rhythm(np.rint(elapsed).astype(np.int64))}"]

    def _row(self, column: Column) -> tuple[str, str, str, str]:
        role = self.proposal.roles.get(column.name, "")
        if column.values is None:
            return str(column.name), "", "", "text"
        if column.unreadable:
            role = f"{role}{', ' if role else ''}{column.unreadable} unreadable"
        return str(column.name), f"{column.values.min():.6g}", f"{column.values.max():.6g}", role


def _columns(table: Table) -> tuple[list[Column], Ending | None]:
    """Every column by itself, so that what is wrong with one costs no row of another; and the file's end."""
    from trundle.adapters.numeral import Real
    from trundle.adapters.table import Wanted
    from trundle.apps.log_proposal import Column
    from trundle.errors import LogSchema

    wanted = [Wanted(place, Real()) for place in range(len(table.names))]
    try:
        together = table.read(wanted)
        if not together.rejected:
            columns = [Column(*pair) for pair in zip(table.names, together.columns, strict=True)]
            return columns, together.ending
    except LogSchema:
        pass
    columns, endings = [], []
    for name, want in zip(table.names, wanted, strict=True):
        try:
            rows = table.read([want])
        except LogSchema:
            columns.append(Column(name, None))
        else:
            columns.append(Column(name, rows.columns[0], rows.rejected.total()))
            endings.append(rows.ending)
    return columns, max(filter(None, endings), key=lambda ending: ending.is_cut, default=None)


class _BagReport:
    """Topics, how often they speak, and by which clock."""

    def __init__(self, log: Path, content: Any, robot: Robot | None) -> None:
        from trundle.adapters.bag import open_bag
        from trundle.adapters.content import Content
        from trundle.adapters.wpilog import open_wpilog
        from trundle.apps.log_proposal import propose_for_topics

        self.clocks: list[str] = []
        opened = open_wpilog if content is Content.WPILOG else open_bag
        with opened(log, salvage=True) as bag:
            rows, topics = [("count", "rate", "longest gap", "topic", "type")], []
            for name in sorted(bag.topics):
                row, topic = self._topic(bag, name)
                rows.append(row)
                topics.append(topic)
            self.losses = list(bag.losses)
            self.warnings = [*self.losses, *bag.warnings]
            times = [t for i in bag.topics.values() for t in (i.first_ns, i.last_ns) if t is not None]
        drive = None if robot is None else robot.measuring
        self.proposal = (
            propose_for_topics(topics)
            if drive is None
            else propose_for_topics(topics, drive.measured_names, drive.steered_names, gyro=drive.gyro)
        )
        duration = (max(times) - min(times)) * 1e-9 if times else 0.0
        words = f"{content.value}, {plural(len(topics), 'topic')}, {seconds(duration)}"
        self.lines = [_headline(log, words), "", *aligned(rows, right=(0, 1, 2))]
        joints = [f"  joints of {t.name}: {', '.join(t.joints)}" for t in topics if t.joints]
        self.lines += ["", *joints, *self.clocks] if joints or self.clocks else []

    def _topic(self, bag: BagReader | WpilogFile, name: str) -> tuple[tuple[str, str, str, str, str], Topic]:
        import numpy as np

        from trundle.apps.log_proposal import Topic
        from trundle.errors import TrundleError

        found = bag.topics[name]
        rate = gap = ""
        offset = None
        joints: dict[str, bool | None] = {}
        try:
            fields = ["name", "position", "velocity"] if found.type.endswith("/JointState") else []
            columns = bag.read(name, fields)
        except TrundleError:  # of a type that holds no numbers
            if found.count > 1 and found.first_ns is not None and found.last_ns is not None:
                duration = max(found.last_ns - found.first_ns, 1) * 1e-9
                rate = f"{digits((found.count - 1) / duration)} Hz"
        else:
            steps = np.diff(columns.receive_ns) * 1e-9
            if (steps > 0.0).any():
                rate = f"{digits(len(steps) / float(steps.sum()))} Hz"
                gap = seconds(float(steps.max()))
            if columns.header_ns is not None and columns.header_ns.any():
                offset = float((columns.receive_ns - columns.header_ns).mean()) * 1e-9
                if found.type.split("/")[0] in _MEASURING:
                    self._clock(name, (columns.receive_ns - columns.header_ns) * 1e-9)
            if fields:
                joints = _joints(columns.columns)
        short = found.type.replace("/msg/", "/")
        short = short if len(short) <= _LONGEST_TYPE else f"{short[: _LONGEST_TYPE - 3]}..."
        row = (str(found.count), rate, gap, name, short)
        return row, Topic(name, found.type, found.count, joints, offset)

    def _clock(self, name: str, late: npt.NDArray[Any]) -> None:
        """Say so where stamps and receipt differ by much [s]."""
        mean, std = float(late.mean()), float(late.std())
        if abs(mean) > _OTHER_CLOCK:
            self.clocks.append(f"  {name}: stamped by a clock of its own, std {seconds(std)}")
        elif abs(mean) > _SKEW or std > _SKEW:
            way = "after" if mean > 0.0 else "before"
            self.clocks.append(f"  {name}: received {seconds(abs(mean))} {way} stamped, std {seconds(std)}")


def _joints(columns: dict[str, Any]) -> dict[str, bool | None]:
    """For each joint whether its positions are whole numbers; None where it has none."""
    import numpy as np

    names, positions = columns["name"], columns["position"]
    if isinstance(names, list):  # the messages differ: every name that comes
        return dict.fromkeys((word for words in names for word in words), False)
    if not isinstance(positions, np.ndarray) or positions.ndim != 2 or positions.shape[1] != len(names):
        return dict.fromkeys(names, None)
    return {
        name: None if not np.ptp(column) else bool((column == np.rint(column)).all())
        for name, column in zip(names, positions.T, strict=True)
    }
