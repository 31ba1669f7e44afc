"""WPILOG data logs: what WPILib's own reader reads, logs on change as wheel logs, and hostile bytes."""

from __future__ import annotations

import contextlib
import struct
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import trundle as tr
from trundle.adapters import resampling
from trundle.adapters.reference import jumps
from trundle.adapters.trajectory import read_trajectory, write_trajectory
from trundle.adapters.wpilog import open_wpilog
from trundle.adapters.wpilog_struct import STRUCTS, UnknownStruct, dtype_of
from trundle.errors import (
    InputError,
    LogCorrupt,
    LogError,
    LogLimit,
    LogSchema,
    LogTruncated,
    TrundleError,
)
from trundle.records.pieces import pieces
from trundle.robot.log_mapping import (
    LogMapping,
    ReferenceMapping,
    ScalarMapping,
    TwistMapping,
    Unit,
    WheelMapping,
)

HEADER = b"WPILOG\x00\x01\x00\x00\x00\x00"
NUMBERS = {"double": "<d", "float": "<f", "int64": "<q", "boolean": "<?"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("wpilog")


# ------------------------------------------------------------------------ a writer for tests


def record(entry: int, microseconds: int, content: bytes, widths=(1, 2, 8)) -> bytes:
    """A record whose head has the wanted bytes of entry, size and time."""
    a, b, c = widths
    head = bytes([(a - 1) | (b - 1) << 2 | (c - 1) << 4])
    return (
        head
        + b"".join(
            number.to_bytes(width, "little")
            for number, width in zip((entry, len(content), microseconds), widths, strict=True)
        )
        + content
    )


def start(entry: int, name: str, kind: str, microseconds: int = 0) -> bytes:
    texts = b"".join(struct.pack("<I", len(text)) + text for text in (name.encode(), kind.encode(), b""))
    return record(0, microseconds, struct.pack("<BI", 0, entry) + texts)


def write(path: Path, *records: bytes) -> Path:
    path.write_bytes(HEADER + b"".join(records))
    return path


def logged(path: Path, entries: dict[str, tuple[str, list[tuple[int, bytes]]]]) -> Path:
    """A log with these entries: name -> type and (microseconds, content)."""
    records = [start(k, name, kind) for k, (name, (kind, _)) in enumerate(entries.items(), 1)]
    values = [(when, k, content) for k, (_, rows) in enumerate(entries.values(), 1) for when, content in rows]
    return write(path, *records, *(record(k, when, content) for when, k, content in sorted(values)))


# --------------------------------------------------------------------------- what is read


@given(
    st.lists(st.floats(allow_nan=False), min_size=1, max_size=5),
    st.lists(st.integers(-(2**63), 2**63 - 1), min_size=1, max_size=5),
    st.tuples(st.integers(1, 4), st.integers(1, 4), st.integers(8, 8)),
)
def test_numbers_are_those_of_wpilib(folder, reals, counts, widths):
    """The same values and stamps as WPILib's own reader, whatever the widths of the heads."""
    log = pytest.importorskip("wpiutil.log")
    path = write(
        folder / "numbers.wpilog",
        start(1, "a", "double"),
        start(2, "b", "int64"),
        *(record(1, k * 1000, struct.pack("<d", value), widths) for k, value in enumerate(reals)),
        *(record(2, k * 1000 + 7, struct.pack("<q", value), widths) for k, value in enumerate(counts)),
    )
    theirs = {1: [], 2: []}
    reader = log.DataLogReader(str(path))
    for r in reader:  # one object, which changes
        if not r.isControl():
            value = r.getDouble() if r.getEntry() == 1 else r.getInteger()
            theirs[r.getEntry()].append((r.getTimestamp() * 1000, value))
    with open_wpilog(path) as ours:
        for entry, name in ((1, "a"), (2, "b")):
            columns = ours.read(name, ["value"])
            values = columns.columns["value"].tolist()
            assert list(zip(columns.receive_ns.tolist(), values, strict=True)) == theirs[entry]


@pytest.mark.parametrize("name", [name for name in STRUCTS if not name.endswith(("Velocity", "Velocities"))])
def test_structs_are_those_of_wpilib(name):
    geometry = pytest.importorskip("wpimath.geometry")
    kinematics = pytest.importorskip("wpimath.kinematics")
    wpistruct = pytest.importorskip("wpiutil.wpistruct")
    theirs = getattr(geometry, name, None) or getattr(kinematics, name)
    assert wpistruct.getSchema(theirs) == STRUCTS[name]
    assert wpistruct.getSize(theirs) == dtype_of(name, {}).itemsize


def test_arrays_and_structs(folder):
    states = struct.pack("<4d", 1.0, 0.1, 2.0, 0.2)
    pose = struct.pack("<3d", 1.0, 2.0, 3.0)
    odd = {"Odd": "enum {a=1, b=2} int8 mode; int16 counts[3]; Rotation2d turn; bool on"}
    path = logged(
        folder / "arrays.wpilog",
        {
            "/.schema/struct:Odd": ("structschema", [(0, odd["Odd"].encode())]),
            "odd": ("struct:Odd", [(1, struct.pack("<b3hd?", -1, 4, 5, 6, 0.5, True))]),
            "states": ("struct:SwerveModuleVelocity[]", [(1, states), (2, states)]),
            "pose": ("struct:Pose2d", [(2, pose), (1, pose)]),
            "xyt": ("double[]", [(1, pose), (2, pose[:16])]),
            "flags": ("boolean[]", [(1, b"\1\0\1")]),
            "text": ("string", [(1, b"hello")]),
        },
    )
    with open_wpilog(path) as log:
        speeds = log.read("states", ["speed", "angle.value.1", "speed.0"]).columns
        assert speeds["speed"].tolist() == [[1.0, 2.0], [1.0, 2.0]]
        assert speeds["angle.value.1"].tolist() == [0.2, 0.2]
        assert speeds["speed.0"].tolist() == [1.0, 1.0]
        poses = log.read("pose", ["translation.y", "rotation.value"])
        assert poses.receive_ns.tolist() == [1000, 2000]
        assert poses.columns["translation.y"].tolist() == [2.0, 2.0]
        odd = log.read("odd", ["mode", "counts.2", "turn.value", "on"]).columns
        assert [column.tolist() for column in odd.values()] == [[-1], [6], [0.5], [True]]
        uneven = log.read("xyt", ["value", "value.2", "value.0"]).columns
        assert [value.tolist() for value in uneven["value"]] == [[1.0, 2.0, 3.0], [1.0, 2.0]]
        np.testing.assert_array_equal(uneven["value.2"], [3.0, np.nan])
        assert uneven["value.0"].tolist() == [1.0, 1.0]
        assert log.read("flags", ["value"]).columns["value"].tolist() == [[True, False, True]]
        for topic, field, words in (
            ("text", "value", "is string, must be one of boolean"),
            ("pose", "rotation", "whole struct; it has rotation.value"),
            ("pose", "x", "it has translation.x, translation.y, rotation.value"),
            ("possé", "x", "did you mean 'pose'"),
        ):
            with pytest.raises(LogSchema, match=words):
                log.read(topic, [field])


def test_an_entry_that_starts_anew_is_one_topic(folder):
    one = struct.pack("<d", 1.0)
    path = write(
        folder / "anew.wpilog",
        start(1, "a", "double"),
        record(1, 1, one),
        record(0, 2, struct.pack("<BI", 1, 1)),  # finished
        start(1, "b", "double"),  # its number is given to another
        record(1, 3, one * 1),
        start(2, "a", "double"),
        record(2, 4, one),
    )
    with open_wpilog(path) as log:
        assert log.read("a", ["value"]).receive_ns.tolist() == [1000, 4000]
        assert log.read("b", ["value"]).receive_ns.tolist() == [3000]
    path = write(folder / "changed.wpilog", start(1, "a", "double"), start(2, "a", "float"))
    with pytest.raises(LogCorrupt, match="starts 'a' anew as 'float', which was 'double'"):
        open_wpilog(path)


# ---------------------------------------------------------------------------- wheel logs


SWERVE = tr.Swerve(
    modules={"fl": (0.2, 0.2), "fr": (0.2, -0.2), "bl": (-0.2, 0.2), "br": (-0.2, -0.2)}, wheel_radius=0.05
)
NAMES = ("fl", "fr", "bl", "br")
MODULES = LogMapping(
    wheels={
        name: WheelMapping(topic="m", field="speed", name=k, unit=Unit.M_S, hold=True)
        for k, name in enumerate(NAMES)
    },
    steering={
        name: ScalarMapping(topic="m", field="angle.value", name=k, hold=True) for k, name in enumerate(NAMES)
    },
    reference=ReferenceMapping(topic="p"),
    twist=TwistMapping(topic="t"),
)


def module_log(path: Path, rows: list[tuple[int, float]], poses=(), kind="SwerveModuleState") -> Path:
    """All four modules straight ahead at these speeds."""
    return logged(
        path,
        {
            "m": (f"struct:{kind}[]", [(us, struct.pack("<8d", *(speed, 0.0) * 4)) for us, speed in rows]),
            "p": ("struct:Pose2d", [(us, struct.pack("<3d", *pose)) for us, pose in poses]),
            "t": (
                "struct:ChassisSpeeds" if kind.endswith("State") else "struct:ChassisVelocities",
                [(us, struct.pack("<3d", speed, 0.0, 0.0)) for us, speed in rows],
            ),
        },
    )


@pytest.mark.parametrize("kind", ["SwerveModuleState", "SwerveModuleVelocity"])
def test_modules_of_both_years(folder, kind):
    """Speeds are typed for swerve: m/s and rad, by the element of the array. Times are microseconds."""
    rows = [(20_000 * k, min(k, 10) * 0.1) for k in range(50)]
    poses = [(us, (0.0, 0.0, 0.1)) for us, _ in rows]
    log = tr.read_log(
        module_log(folder / "m.wpilog", rows, poses, kind), tr.Robot(drive=SWERVE), mapping=MODULES
    )
    assert log.time_ns.tolist() == [20_000_000 * k for k in range(50)]
    np.testing.assert_allclose(log.wheels[:, 2] * 0.05, [speed for _, speed in rows], atol=1e-15)
    np.testing.assert_array_equal(log.steering, np.zeros((50, 4)))
    np.testing.assert_allclose(log.twists[:, 0], [speed for _, speed in rows])
    assert log.reference.poses[7].tolist() == [0.0, 0.0, 0.1]
    assert log.warnings == ()


@given(st.lists(st.sampled_from([0.0, 0.5, 1.0, 1.5]), min_size=4, max_size=60))
def test_what_is_logged_on_change_is_held(folder, speeds):
    """A log of the changes alone covers the distance that a log of every cycle covers."""
    speeds = [0.0, 0.2, 0.0, *speeds, 0.0, 0.3, 0.0]
    every = [(20_000 * k, speed) for k, speed in enumerate(speeds)]
    changed = [every[0]] + [row for row, before in zip(every[1:], every, strict=False) if row[1] != before[1]]
    robot, poses = tr.Robot(drive=SWERVE), [(0, (0.0, 0.0, 0.0))]
    whole, few = (
        tr.integrate(
            robot,
            tr.read_log(module_log(folder / "h.wpilog", rows, poses), robot, mapping=MODULES),
            integrator="arc",
        )
        for rows in (every, changed)
    )
    assert few.events == {}
    assert few.poses[-1] == pytest.approx(whole.poses[-1], abs=1e-12)


def test_one_cycle_is_one_row():
    cycle = np.arange(10) * 20_000_000
    rows = resampling.changes("log", [cycle, cycle + 100_000, cycle[::3] + 250_000])
    assert rows.tolist() == [int(c) + (250_000 if k % 3 == 0 else 100_000) for k, c in enumerate(cycle)]


def test_silence_is_held_but_not_for_ever():
    cycle = np.arange(10) * 20_000_000
    rows = resampling.changes("log", [np.append(cycle, cycle + 3_600_000_000_000)])
    assert np.diff(rows).max() <= resampling.LONGEST_BRIDGE_NS
    with pytest.raises(LogLimit, match="hours of silence"):
        resampling.changes("log", [np.append(cycle, cycle + 2**62)])


def test_a_reset_is_seen(folder):
    """Poses jump where a simulation starts anew; wheels do not see it. The pieces are whole."""
    rows = [(20_000 * k, 0.5) for k in range(100)]
    poses = [(us, (0.01 * k + (3.0 if k >= 60 else 0.0), 0.0, 0.0)) for k, (us, _) in enumerate(rows)]
    robot = tr.Robot(drive=SWERVE)
    log = tr.read_log(module_log(folder / "r.wpilog", rows, poses), robot, mapping=MODULES)
    assert dict(log.reference.events) == {"jump": 1}
    assert log.warnings == ("the reference jumps at 1.200 s: compare piece by piece",)
    cuts = jumps(log.reference)
    assert cuts.tolist() == [1_200_000_000]
    for trajectory in (log.reference, tr.integrate(robot, log)):
        assert [len(piece) for piece in pieces(trajectory, cuts)] == [60, 40]


# --------------------------------------------------------------------------- trajectories


def a_trajectory(count: int = 20, *, full: bool = True) -> tr.Trajectory:
    rng = np.random.default_rng(3)
    return tr.Trajectory(
        time_ns=1_700_000_000_123_456_789 + np.arange(count) * 20_000_001,
        poses=rng.normal(size=(count, 3)) * 10.0,
        twists=rng.normal(size=(count, 3)) if full else None,
        covariances=rng.normal(size=(count, 3, 3)) if full else None,
        frame="world",
    )


@pytest.mark.parametrize("full", [True, False], ids=["full", "poses"])
@pytest.mark.parametrize("count", [0, 1, 20])
def test_trajectories_read_back_the_same(folder, full, count):
    trajectory = a_trajectory(count, full=full)
    write_trajectory(trajectory, folder / "t.wpilog", force=True)
    back = read_trajectory(folder / "t.wpilog")
    for name in ("time_ns", "poses", "twists", "covariances"):
        np.testing.assert_array_equal(getattr(back, name), getattr(trajectory, name))
    assert (back.frame, back.child_frame) == ("world", "base_link")


def test_wpilib_reads_what_we_write(folder):
    """Poses, with the schemas that AdvantageScope looks for."""
    log = pytest.importorskip("wpiutil.log")
    wpistruct = pytest.importorskip("wpiutil.wpistruct")
    geometry = pytest.importorskip("wpimath.geometry")
    trajectory = a_trajectory()
    write_trajectory(trajectory, folder / "w.wpilog", force=True)
    reader = log.DataLogReader(str(folder / "w.wpilog"))
    assert reader.isValid()
    entries, schemas, poses = {}, {}, []
    for entry in reader:
        if entry.isStart():
            begun = entry.getStartData()
            entries[begun.entry] = (begun.name, begun.type)
            continue
        name, kind = entries[entry.getEntry()]
        if kind == "structschema":
            schemas[name] = bytes(entry.getRaw()).decode()
        elif name == "/trundle/pose":
            assert kind == "struct:Pose2d"
            pose = wpistruct.unpack(geometry.Pose2d, bytes(entry.getRaw()))
            poses.append((entry.getTimestamp(), pose.x, pose.y, pose.rotation().radians()))
    for struct_type in (geometry.Pose2d, geometry.Translation2d, geometry.Rotation2d):
        assert schemas[f"/.schema/struct:{struct_type.__name__}"] == wpistruct.getSchema(struct_type)
    stamps, *columns = np.array(poses, dtype=object).T
    assert stamps.tolist() == (trajectory.time_ns // 1000).tolist()
    np.testing.assert_array_equal(np.array(columns[:2], float), trajectory.poses.T[:2])
    heading = np.exp(1j * np.array(columns[2], float))
    np.testing.assert_allclose(heading, np.exp(1j * trajectory.poses[:, 2]), atol=1e-14)


def test_poses_of_others_are_a_trajectory_if_there_is_one(folder):
    pose = struct.pack("<3d", 1.0, 2.0, 3.0)
    path = logged(folder / "o.wpilog", {"NT:/Pose": ("struct:Pose2d", [(5, pose)])})
    assert read_trajectory(path).poses.tolist() == [[1.0, 2.0, 3.0]]
    two = {"A": ("struct:Pose2d", [(5, pose)]), "B": ("struct:Pose2d", [(5, pose)])}
    with pytest.raises(LogSchema, match="several entries are poses: A, B"):
        read_trajectory(logged(folder / "o.wpilog", two))
    with pytest.raises(LogSchema, match="no entry is a struct:Pose2d"):
        read_trajectory(write(folder / "o.wpilog"))


def test_negative_stamps_have_no_wpilog(folder):
    trajectory = tr.Trajectory(time_ns=np.array([-1]), poses=np.zeros((1, 3)))
    with pytest.raises(InputError, match="-1 ns, must be >= 0"):
        write_trajectory(trajectory, folder / "n.wpilog")


# ------------------------------------------------------------------------- hostile bytes


def small(folder: Path) -> Path:
    """A log with a bit of everything."""
    trajectory = a_trajectory(6)
    write_trajectory(trajectory, folder / "small.wpilog", force=True)
    return folder / "small.wpilog"


def everything(path: Path, *, salvage: bool) -> tuple[dict[str, list[int]], list[str]]:
    """The stamps of all numbers that a log holds, and its losses."""
    with open_wpilog(path, salvage=salvage) as log:
        found = {}
        for topic, info in log.topics.items():
            try:
                found[topic] = log.read(topic, ["value"]).receive_ns.tolist()
            except LogSchema:
                if info.type.startswith("struct:Pose2d"):
                    found[topic] = log.read(topic, ["translation.x"]).receive_ns.tolist()
        return found, log.losses


@pytest.mark.parametrize("content", [b"", None])
def test_what_is_no_file_of_bytes(folder, content):
    path = folder / f"{content}.wpilog"
    if content is not None:
        path.write_bytes(content)
    with pytest.raises(LogError, match="no such file" if content is None else "holds no bytes"):
        open_wpilog(path)


@pytest.mark.parametrize("row", [pytest.param("L2", id="L2")])
def test_fault(folder, row):
    """Cut at any byte: refused, or every whole record before the cut and a word about the loss."""
    assert row == "L2"
    whole = small(folder).read_bytes()
    complete, losses = everything(small(folder), salvage=False)
    assert losses == []
    ends, path = set(), folder / "cut.wpilog"
    for size in range(1, len(whole)):
        path.write_bytes(whole[:size])
        if size < len(HEADER):
            with pytest.raises(LogTruncated):
                open_wpilog(path)
            continue
        found, losses = everything(path, salvage=True)
        if losses:
            with pytest.raises(LogTruncated, match=f"ends at byte {size},"):
                open_wpilog(path)
        else:
            everything(path, salvage=False)
            ends.add(size)
        for topic, stamps in found.items():
            assert stamps == complete.get(topic, [])[: len(stamps)]
    # Only between two records nothing says that more should come.
    assert len(ends) == 4 * 2 + 4 + 6 * 4


def test_flipped_bits_never_escape(folder):
    """The format has no checksum, so a number may change; but nothing else goes wrong."""
    whole = bytearray(small(folder).read_bytes())
    path, rng = folder / "flip.wpilog", np.random.default_rng(5)
    refused = 0
    for _ in range(600):
        bit = int(rng.integers(8 * len(whole)))
        whole[bit // 8] ^= 1 << bit % 8
        path.write_bytes(whole)
        for salvage in (False, True):
            try:
                everything(path, salvage=salvage)
                read_trajectory(path)
            except TrundleError:
                refused += 1
        whole[bit // 8] ^= 1 << bit % 8
    assert refused > 100


def test_a_name_that_no_entry_has_is_answered_with_those_like_it(folder):
    """A robot logs hundreds of entries; an error names a line of them."""
    names = [f"/drive/module{k}/{word}" for k in range(100) for word in ("angle", "speed", "volts")]
    records = [start(k + 1, name, "double") for k, name in enumerate(names)]
    with open_wpilog(write(folder / "many.wpilog", *records)) as log, pytest.raises(LogSchema) as found:
        log.read("/drive/module7/sped", [])
    message = str(found.value)
    assert "no topic '/drive/module7/sped'; did you mean '/drive/module7/speed'? It has" in message
    assert "and 288 more (trundle info lists all)" in message
    assert len(message) < 500


@given(st.binary(max_size=200))
def test_any_bytes_are_an_error_of_ours(folder, content):
    path = folder / "any.wpilog"
    path.write_bytes(HEADER + content)
    for salvage in (False, True):
        with contextlib.suppress(TrundleError):
            everything(path, salvage=salvage)


def test_structure_that_lies(folder):
    one = struct.pack("<d", 1.0)
    a, path = start(1, "a", "double"), folder / "lies.wpilog"
    for content, words in (
        ((a, record(2, 1, one)), "entry 2, which was never started"),
        ((a, record(1, 1, one[:7])), "has 7 bytes, which its entry cannot have"),
        ((a, b"\x80" + one * 3), "has a reserved bit set"),
        ((a, record(1, 2**63, one)), "beyond 292 years"),
        ((a, record(0, 1, b"\x07aaaa")), "says nothing that is known"),
        ((record(0, 1, struct.pack("<BII", 0, 1, 2**32 - 1)),), "ends inside the description"),
    ):
        write(path, *content)
        with pytest.raises(LogCorrupt, match=words):
            open_wpilog(path)
        with open_wpilog(path, salvage=True) as log:
            assert log.losses
    write(path, a, record(1, 5_000_000, one), record(1, 1, one))
    with pytest.raises(LogError, match="go back by 5 s") as caught, open_wpilog(path) as log:
        log.read("a", ["value"])
    assert caught.value.reason == "unsorted"
    path.write_bytes(b"WPILOG\x00\x02" + bytes(4))
    with pytest.raises(LogError, match=r"WPILOG 2\.0, must be 1\.0"):
        open_wpilog(path)
    path.write_bytes(b"\x30" + HEADER)
    with pytest.raises(LogError, match="its content is not WPILOG"):
        open_wpilog(path)


@pytest.mark.parametrize(
    ("schema", "words"),
    [
        ("A a", "holds itself"),
        ("double x[9999999]", "more than 1048576 bytes"),
        ("int8 a:4", "says 'int8 a:4'"),
        ("Unknown u", "does not hold the schema of struct Unknown"),
        ("", "no members"),
        ("double x;double x", "two of one name"),
        ("double x[0]", "no members"),
    ],
)
def test_schemas_that_lie(schema, words):
    with pytest.raises(UnknownStruct, match=words):
        dtype_of("A", {"A": schema})
    bomb = {f"S{k}": f"S{k + 1} a[100]" for k in range(20)} | {"S14": "double x"}
    with pytest.raises(UnknownStruct):
        dtype_of("S0", bomb)
