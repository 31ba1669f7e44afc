"""Trajectories of other programs: KITTI, EuRoC, JSON lines, and takes of OptiTrack's Motive."""

from __future__ import annotations

import csv
import io
import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

import trundle as tr
from trundle.adapters.motive import read_motive
from trundle.adapters.quaternion import continuous
from trundle.adapters.trajectory import TRAJECTORY_SUFFIXES, read_trajectory, write_trajectory
from trundle.apps.cli import main
from trundle.errors import InputError, LogError, LogLimit, LogSchema
from trundle.geometry import se2
from trundle.records import Trajectory
from trundle.robot.log_mapping import Kind, LogMapping, ReferenceMapping, TimeMapping

FINITE = st.floats(-1e9, 1e9)
NUMBERS = arrays.arrays(float, (4, 3), elements=FINITE)
DRIVE = tr.Differential(track_width=0.2, wheel_radius=0.04)
STAMPS = arrays.arrays(np.int64, 4, elements=st.integers(-(2**60), 2**60), unique=True).map(np.sort)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("formats")


def turning(count: int = 30) -> Trajectory:
    angle = np.linspace(-3.0, 9.0, count)
    poses = np.stack([np.sin(angle), 1.0 - np.cos(angle), angle], axis=-1)
    return Trajectory(time_ns=1_700_000_000_123_456_789 + np.arange(count) * 20_000_001, poses=poses)


def check_poses(found, wanted, *, atol=1e-15):
    np.testing.assert_array_equal(found[:, :2], wanted[:, :2])
    np.testing.assert_allclose(np.exp(1j * found[:, 2]), np.exp(1j * wanted[:, 2]), atol=atol)


# ---------------------------------------------------------------------------- evo as judge


@pytest.mark.parametrize(
    ("suffix", "reader"), [(".kitti", "read_kitti_poses_file"), (".euroc", "read_euroc_csv_trajectory")]
)
def test_evo_reads_what_we_write(folder, suffix, reader):
    evo = pytest.importorskip("evo.tools.file_interface")
    write_trajectory(turning(), folder / f"ours{suffix}", force=True)
    theirs = getattr(evo, reader)(str(folder / f"ours{suffix}"))
    yaw = [np.arctan2(pose[1, 0], pose[0, 0]) for pose in theirs.poses_se3]
    check_poses(np.column_stack([theirs.positions_xyz[:, :2], yaw]), turning().poses)
    if suffix == ".euroc":
        np.testing.assert_allclose(theirs.timestamps, turning().time_ns * 1e-9, rtol=1e-15)


def test_kitti_that_evo_wrote(folder):
    evo = pytest.importorskip("evo.tools.file_interface")
    trajectory = pytest.importorskip("evo.core.trajectory")
    poses = []
    for x, y, theta in turning().poses:
        c, s = np.cos(theta), np.sin(theta)
        poses.append(np.array([[c, -s, 0, x], [s, c, 0, y], [0, 0, 1, 0], [0, 0, 0, 1]]))
    evo.write_kitti_poses_file(str(folder / "evo.kitti"), trajectory.PosePath3D(poses_se3=poses))
    back = read_trajectory(folder / "evo.kitti")
    np.testing.assert_allclose(back.poses[:, :2], turning().poses[:, :2], atol=1e-12)


# ------------------------------------------------------------------------------ round trips


@given(STAMPS, NUMBERS)
def test_euroc_keeps_stamps_and_poses(folder, time_ns, poses):
    write_trajectory(Trajectory(time_ns=time_ns, poses=poses), folder / "any.euroc", force=True)
    back = read_trajectory(folder / "any.euroc")
    np.testing.assert_array_equal(back.time_ns, time_ns)
    check_poses(back.poses, poses)


@given(NUMBERS)
def test_kitti_keeps_poses_and_says_that_it_has_no_times(folder, poses):
    write_trajectory(Trajectory(time_ns=np.arange(4), poses=poses), folder / "any.kitti", force=True)
    back = read_trajectory(folder / "any.kitti")
    assert back.time_ns.tolist() == [0, 1_000_000_000, 2_000_000_000, 3_000_000_000]
    assert not back.timed
    assert "no times" in repr(back)
    check_poses(back.poses, poses)


@given(STAMPS, arrays.arrays(float, (4, 3), elements=st.floats(allow_nan=False, allow_infinity=False)))
def test_json_lines_keep_everything(folder, time_ns, numbers):
    covariances = np.broadcast_to(np.eye(3), (4, 3, 3))
    trajectory = Trajectory(time_ns=time_ns, poses=numbers, twists=-numbers, covariances=covariances)
    write_trajectory(trajectory, folder / "any.jsonl", force=True)
    back = read_trajectory(folder / "any.jsonl")
    np.testing.assert_array_equal(back.time_ns, time_ns)
    for name in ("poses", "twists", "covariances"):
        np.testing.assert_array_equal(getattr(back, name), getattr(trajectory, name))
    first = json.loads((folder / "any.jsonl").read_text().splitlines()[0])
    assert first["time_ns"] == time_ns[0]


def test_every_format_is_read_and_written_by_convert(folder, capsys):
    pytest.importorskip("pyarrow")
    start = folder / "start.csv"
    write_trajectory(turning(), start)
    for suffix in TRAJECTORY_SUFFIXES:
        other = folder / f"other{suffix}"
        assert main(["convert", str(start), str(other)]) == 0
        assert main(["convert", str(other), str(folder / "back.csv"), "--force"]) == 0
        check_poses(read_trajectory(folder / "back.csv").poses, turning().poses, atol=1e-12)
    assert "other.kitti: has no times; the output's stamps number its rows" in capsys.readouterr().err


@pytest.mark.parametrize("verb", ["track", "convert"])
def test_help_knows_every_suffix(verb, capsys):
    assert main([verb, "--help"]) == 0
    said = capsys.readouterr().out
    assert [suffix for suffix in TRAJECTORY_SUFFIXES if suffix not in said] == []


def test_help_of_info_knows_every_kind_of_log(capsys):
    from trundle.adapters.content import Content

    assert main(["info", "--help"]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert [content.value for content in Content if content.value not in said] == []


@pytest.mark.parametrize("suffix", TRAJECTORY_SUFFIXES)
def test_turns_outlive_every_format(folder, suffix):
    """A robot that turned three times knows it. Only turns before the first row may be lost."""
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    angle = 7.0 + np.concatenate([np.linspace(0.0, 25.0, 80), np.linspace(25.0, -30.0, 160)])
    poses = np.stack([np.sin(angle), 1.0 - np.cos(angle), angle], axis=-1)
    write_trajectory(Trajectory(time_ns=np.arange(240) * 50_000_000, poses=poses), folder / f"turns{suffix}")
    back = read_trajectory(folder / f"turns{suffix}")
    before = 2.0 * np.pi * np.rint((angle[0] - back.poses[0, 2]) / (2.0 * np.pi))
    np.testing.assert_allclose(back.poses[:, 2] + before, angle, atol=1e-13)
    assert -np.pi < back.poses[0, 2] <= np.pi or before == 0.0


def test_turns_are_followed_past_rows_without_a_heading():
    wrapped = se2.wrap(np.linspace(0.0, 20.0, 60))
    assert np.abs(np.diff(wrapped)).max() > 5.0
    wrapped[[0, 20, 21, 59]] = np.nan
    followed = continuous(wrapped)
    wanted = np.where(np.isnan(wrapped), np.nan, np.linspace(0.0, 20.0, 60))
    np.testing.assert_allclose(followed, wanted, atol=1e-13)
    assert continuous(np.empty(0)).shape == (0,)


# ------------------------------------------------------------------------- what is refused


@pytest.mark.parametrize("suffix", [".kitti", ".euroc", ".jsonl"])
@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_what_a_format_cannot_say_is_refused(folder, suffix, value):
    poses = turning().poses.copy()
    poses[3, 2] = value
    with pytest.raises(InputError, match=rf"must be finite in a {suffix} file"):
        write_trajectory(Trajectory(time_ns=turning().time_ns, poses=poses), folder / f"no{suffix}")
    assert not (folder / f"no{suffix}").exists()


@pytest.mark.parametrize(
    ("name", "text", "words"),
    [
        ("a.kitti", "1 0 0 0 0 1 0 0 0 0 1\n", "11 columns, must be the 12"),
        ("b.kitti", "1 0 0 0 0 1 0 0 0 0 1 0\n1 0 0 x 0 1 0 0 0 0 1 0\n", "all must be whole"),
        ("b0.kitti", "0 0 0 0 0 0 0 0 0 0 1 0\n", "row 0 is no pose in the plane"),
        ("b8.kitti", "1 2 3 0 0 0 0 1\n", "8 columns, must be the 12 .* name it .tum"),
        ("a.tum", "1 0 0 0 0 1 0 0 0 0 1 0\n", "rows of 12, must be the 8 .* name it .kitti"),
        ("b.tum", "1 0 0 0 0 0 0 1 9 9\n", "rows of 10, must be the 8 columns"),
        ("c.tum", "1,0,0,0,0,0,0,1\n", "rows of 1, must be the 8 columns .* divided by blanks"),
        ("d.tum", "1 0 0 0 0 0 0 0\n2 nan 0 0 0 0 0 1\n", "no row of 2 holds a pose"),
        ("e.tum", "5 0 0 0 0 0 0 1\n3 0 0 0 0 0 0 1\n", r"row 1 is stamped 3 s, 2 s before .* \[unsorted\]"),
        ("c.euroc", "#timestamp\n1,2,3,4\n", "4 columns, must be at least the 8"),
        ("d.euroc", "#timestamp\n", "no"),
        ("e.jsonl", '{"time_ns": 1, "x": 2}\n', "no column 'y'"),
    ],
)
def test_files_that_lack_something(folder, name, text, words):
    (folder / name).write_text(text)
    with pytest.raises(LogError, match=words):
        read_trajectory(folder / name)


@pytest.mark.parametrize("suffix", [".tum", ".euroc"])
def test_rows_that_are_no_poses_and_stamps_that_repeat_are_counted(folder, suffix):
    """As the rows of a log are: late ones are put in order, no heading is nan, no stamp comes twice."""
    rows = [
        "0.0 0 1",
        "0.2 2 1",
        "0.1 1 1",
        "0.3 3 0",
        "0.4 nan 1",
        "0.5 5 1",
        "0.5 5 1",
        "0.5 6 1",
        "0.6 inf 1",
    ]
    lines = ["#timestamp"]
    for stamp, x, w in map(str.split, rows):
        time_ns = str(round(float(stamp) * 1e9))
        cells = [stamp, x, "0 0 0 0 0", w] if suffix == ".tum" else [time_ns, x, "0,0", w, "0,0,0"]
        lines.append((" " if suffix == ".tum" else ",").join(cells))
    (folder / f"odd{suffix}").write_text("\n".join([*lines, ""]))
    back = read_trajectory(folder / f"odd{suffix}")
    assert back.poses[:, 0].tolist() == [0, 1, 2, 5]
    assert back.time_ns.tolist() == [0, 100_000_000, 200_000_000, 500_000_000]
    assert back.rejected == {"nonfinite": 3, "duplicate": 1, "duplicate_conflict": 1}
    assert back.events == {"reordered": 1}
    assert np.isfinite(back.poses).all()


@pytest.mark.parametrize("suffix", [".tum", ".csv", ".jsonl", ".parquet", ".euroc", ".wpilog"])
def test_stamps_that_go_back_are_no_trajectory(folder, suffix):
    path = folder / f"goes_back{suffix}"
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    two = Trajectory(time_ns=np.array([5, 1, 1]) * 10**9, poses=np.eye(3))
    write_trajectory(two, path)
    with pytest.raises(LogError, match=r" 4 s.*\[unsorted\]"):
        read_trajectory(path)


@pytest.mark.parametrize("head", ["#timestamp [ns],p_x", "# timestamp, p_x", "#timestamp,p"])
def test_euroc_by_its_usual_suffix(folder, head):
    """As the data set's own state estimates are: more columns behind, z and tilt among them."""
    half = np.sqrt(0.5)
    rows = [
        f"1403636580838555648,4.5,-1.5,0.5,{half},0,0,{half},0.1,0.2,0.3",
        "1403636580843555648,5,-2,0.5,0,0,0,-2,0,0,0",
    ]
    (folder / "state.csv").write_text("\n".join([head, *rows, "1403636580848555648,,,,1,0,0,0,0,0,0", ""]))
    back = read_trajectory(folder / "state.csv")
    assert back.time_ns.tolist() == [1403636580838555648, 1403636580843555648]
    np.testing.assert_allclose(back.poses, [[4.5, -1.5, np.pi / 2], [5, -2, np.pi]])
    assert back.rejected == {"parse": 1}


# -------------------------------------------------------------------------------- Motive


def turned(heading: float) -> tuple[float, float, float, float]:
    """Quaternion x, y, z, w of a heading about Motive's y axis, which points up."""
    return (0.0, float(np.sin(heading / 2)), 0.0, float(np.cos(heading / 2)))


def take(bodies, rows, *, unit="Meters", rotation="Quaternion", marker=True, version="1.23") -> str:
    """A take as Motive exports it."""
    axes = {"Quaternion": "XYZW", "XYZ": "XYZ"}[rotation]
    head = [
        "Format Version",
        version,
        "Take Name",
        "Take 2024-01-02 11.12.13 AM",
        "Capture Frame Rate",
        "120.000000",
    ]
    head += ["Rotation Type", rotation, "Length Units", unit, "Coordinate Space", "Global"]
    kinds, names, ids, quantities, last = ([""] * 2 for _ in range(5))
    kinds[1], names[1], ids[1], last = "Type", "Name", "ID", ["Frame", "Time (Seconds)"]
    for body in bodies:
        parts = [("Rigid Body", body, "Rotation", axis) for axis in axes]
        parts += [("Rigid Body", body, "Position", axis) for axis in "XYZ"]
        parts += [("Rigid Body", body, "Mean Marker Error", "")]
        parts += (
            [("Rigid Body Marker", f"{body}:Marker1", "Position", axis) for axis in "XYZ"] if marker else []
        )
        for kind, name, quantity, axis in parts:
            kinds.append(kind)
            names.append(name)
            ids.append("1")
            quantities.append(quantity)
            last.append(axis)
    file = io.StringIO()
    writer = csv.writer(file)
    writer.writerow(head)
    file.write("\r\n")
    writer.writerows([kinds, names, ids, quantities, last, *rows])
    return file.getvalue()


def seen(k, heading, x, y, *, scale=1.0):
    """A row: the floor's y is Motive's -z."""
    position = [x / scale, 0.3 / scale, -y / scale]
    return [k, k / 120, *turned(heading), *position, 0.0002, *position]


def written(folder, text, name="take.csv"):
    (folder / name).write_text(text, newline="")
    return folder / name


@pytest.mark.parametrize(("unit", "scale"), [("Meters", 1.0), ("Centimeters", 0.01), ("Millimeters", 0.001)])
def test_a_take_is_a_trajectory_on_the_floor(folder, unit, scale):
    headings = np.linspace(-3.0, 3.0, 20)
    rows = [seen(k, heading, 0.1 * k, 0.2 * k, scale=scale) for k, heading in enumerate(headings)]
    back = read_trajectory(written(folder, take(["Robot"], rows, unit=unit)))
    wanted = np.column_stack([0.1 * np.arange(20), 0.2 * np.arange(20), headings])
    np.testing.assert_allclose(back.poses, wanted, atol=1e-12)
    np.testing.assert_array_equal(back.time_ns, np.rint(np.arange(20) / 120 * 1e9))


@given(st.tuples(*[st.floats(-180, 180)] * 3))
def test_angles_are_those_of_scipy(folder, angles):
    rotation = pytest.importorskip("scipy.spatial.transform").Rotation
    ahead = rotation.from_euler("XYZ", angles, degrees=True).apply([1.0, 0.0, 0.0])
    if np.hypot(ahead[0], ahead[2]) < 1e-6:
        return  # it points straight up
    row = [0, 0.0, *angles, 1.0, 0.0, -2.0, 0.0, 0.0, 0.0, 0.0]
    back = read_motive(written(folder, take(["Robot"], [row], rotation="XYZ")))
    wanted = np.arctan2(-ahead[2], ahead[0])
    np.testing.assert_allclose(np.exp(1j * back.poses[0, 2]), np.exp(1j * wanted), atol=1e-8)


def test_where_the_body_was_not_seen_is_counted(folder):
    rows = [seen(k, 0.1, k, k) for k in range(6)]
    rows[2][2:] = [""] * (len(rows[2]) - 2)
    rows[4][6] = "x"
    back = read_motive(written(folder, take(["Robot"], rows)))
    assert back.time_ns.tolist() == [0, 8333333, 25000000, 41666667]
    assert back.rejected == {"untracked": 1, "parse": 1}


def test_one_of_several_bodies_is_chosen_by_name(folder):
    rows = [[*seen(k, 0.1, k, 1), *seen(k, 0.2, k, 2)[2:]] for k in range(5)]
    path = written(folder, take(["Robot", "Lift, front"], rows))
    assert read_motive(path, "Lift, front").poses[:, 1].tolist() == [2.0] * 5
    with pytest.raises(LogSchema, match=r"its rigid bodies are Robot, Lift, front; choose one: --body"):
        read_trajectory(path)
    with pytest.raises(LogSchema, match="did you mean 'Robot'"):
        read_motive(path, "Robto")
    assert main(["convert", str(path), str(folder / "lift.tum"), "--body", "Lift, front"]) == 0
    assert read_trajectory(folder / "lift.tum").poses[:, 1].tolist() == [2.0] * 5
    assert main(["convert", str(path), str(folder / "none.tum")]) == 3
    assert not (folder / "none.tum").exists()


def test_a_take_beside_a_log_is_its_reference(folder):
    headings = np.linspace(0.0, 1.0, 40)
    written(folder, take(["Robot"], [seen(k, h, 0.1 * k, 0.0) for k, h in enumerate(headings)]))
    cells = "\n".join(f"{k / 120},{k},{k}" for k in range(40))
    log = written(folder, f"time,left.position,right.position\n{cells}\n", "wheels.csv")
    reference = ReferenceMapping(file="take.csv", topic="Robot", mounting=(0.05, 0.0, 0.0))
    found = tr.read_log(log, DRIVE, mapping=LogMapping(reference=reference))
    wanted = np.column_stack(
        [0.1 * np.arange(40) - 0.05 * np.cos(headings), -0.05 * np.sin(headings), headings]
    )
    np.testing.assert_allclose(found.reference.poses, wanted, atol=1e-12)


BROKEN = {
    "no header": ("Format Version,1.2\n1,2,3\n", "no row begins with 'Frame'"),
    "unit": (take(["Robot"], [seen(0, 0, 0, 0)], unit="Inches"), "Length Units is 'Inches'"),
    "rotation": (take(["Robot"], [seen(0, 0, 0, 0)]).replace("Quaternion", "ZYX"), "Rotation Type is 'ZYX'"),
    "no body": (take([], [[0, 0.0]]), "its rigid bodies are none"),
    "no rotation": (
        take(["Robot"], [seen(0, 0, 0, 0)]).replace("Rotation,", "Rotated,"),
        "no column is the Rotation X",
    ),
    "never seen": (take(["Robot"], [[0, 0.0, *[""] * 11]]), "no row in which the body was seen"),
    "no names": (take(["Robot"], [seen(0, 0, 0, 0)]).replace(",Name,", ",Nom,"), "says the Name"),
}


@pytest.mark.parametrize("name", BROKEN)
def test_takes_that_cannot_be_read_say_why(folder, name):
    text, words = BROKEN[name]
    with pytest.raises(LogError, match=words):
        read_trajectory(written(folder, text))


def test_a_cut_take_loses_no_row_that_ends(folder):
    text = take(["Robot"], [seen(k, 0.1, k, 1) for k in range(12)]).encode()
    begin = text.index(b"Frame,Time")
    for at in range(begin, len(text), 7):
        whole = text[begin:at].count(b"\r\n") - 1
        (folder / "cut.csv").write_bytes(text[:at])
        try:
            back = read_trajectory(folder / "cut.csv")
        except LogError:
            assert whole <= 0
        else:
            assert len(back) - whole in (0, 1)  # a last row may be whole but for its end


def test_an_endless_line_is_no_take(folder, monkeypatch):
    monkeypatch.setattr("trundle.adapters.motive.LONGEST_LINE", 500)
    with pytest.raises(LogLimit, match="longer than 500 bytes"):
        read_trajectory(written(folder, take(["Robot"], [seen(0, 0, 0, 0)]) + "1," * 5000))


# ---------------------------------------------------------------------------- steps that add up


def steps_log(folder, steps):
    rows = [f"0.1,{k},{k},{x!r},{y!r},{a!r}" for k, (x, y, a) in enumerate(steps)]
    path = written(folder, "\n".join(["dt,left.position,right.position,dx,dy,da", *rows, ""]), "steps.csv")
    reference = ReferenceMapping(columns=("dx", "dy", "da"), kind=Kind.INCREMENT)
    mapping = LogMapping(time=TimeMapping(column="dt", kind=Kind.INCREMENT), reference=reference)
    return tr.read_log(path, DRIVE, mapping=mapping)


def test_a_reference_of_steps_is_joined(folder):
    """As a scan matcher says it: each motion in the frame that the one before led to."""
    truth = turning(25).poses
    steps = se2.compose(se2.inverse(truth[:-1]), truth[1:]).tolist()
    log = steps_log(folder, steps)
    np.testing.assert_allclose(log.reference.time_ns, np.arange(1, 25) * 100_000_000)
    check_poses_nearly(log.reference.poses, se2.compose(se2.inverse(truth[0]), truth[1:]))

    steps[7][2] = float("nan")  # no step behind it can be placed
    log = steps_log(folder, steps)
    assert log.reference is None
    assert "adds up row by row, so all must be whole" in log.warnings[0]


def check_poses_nearly(found, wanted):
    np.testing.assert_allclose(found[:, :2], wanted[:, :2], atol=1e-12)
    np.testing.assert_allclose(np.exp(1j * found[:, 2]), np.exp(1j * wanted[:, 2]), atol=1e-12)
