"""Trajectories to files and back, and files that are whole at any moment."""

from __future__ import annotations

import importlib.util
import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from trundle.adapters.atomic import atomic_path
from trundle.adapters.trajectory import read_trajectory, write_trajectory
from trundle.errors import InputError, LogError, LogSchema, OutputError
from trundle.records import Trajectory

FINITE = st.floats(allow_nan=False, allow_infinity=False)
STAMPS = arrays.arrays(
    np.int64, st.integers(1, 6), elements=st.integers(-(2**63) + 1, 2**63 - 1), unique=True
).map(np.sort)
TABLES = [".csv", ".parquet"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("trajectories")


def circle(count: int = 50, *, full: bool = True) -> Trajectory:
    angle = np.linspace(-3.0, 9.0, count)
    poses = np.stack([np.sin(angle), 1.0 - np.cos(angle), angle], axis=-1)
    root = np.random.default_rng(1).normal(size=(count, 3, 3))
    covariances = root @ root.transpose(0, 2, 1)
    return Trajectory(
        time_ns=1_700_000_000_123_456_789 + np.arange(count) * 20_000_001,
        poses=poses,
        twists=np.ones((count, 3)) / 3.0 if full else None,
        covariances=(covariances + covariances.transpose(0, 2, 1)) / 2.0 if full else None,
    )


def check_equal(one: Trajectory, other: Trajectory) -> None:
    np.testing.assert_array_equal(one.time_ns, other.time_ns)
    for name in ("poses", "twists", "covariances"):
        first, second = getattr(one, name), getattr(other, name)
        assert (first is None) == (second is None)
        if first is not None:
            assert first.tobytes() == second.tobytes()


# --------------------------------------------------------------------------- round trips


@pytest.mark.parametrize("suffix", TABLES)
@pytest.mark.parametrize("full", [True, False], ids=["full", "poses"])
def test_tables_read_back_the_same(folder, suffix, full):
    if suffix == ".parquet":
        pytest.importorskip("pyarrow")
    path = folder / f"run{suffix}"
    write_trajectory(circle(full=full), path, force=True)
    check_equal(read_trajectory(path), circle(full=full))


@given(STAMPS, st.data())
def test_every_stamp_and_number_survives_csv(folder, time_ns, data):
    numbers = arrays.arrays(float, (len(time_ns), 3), elements=st.floats(width=64))
    poses = np.nan_to_num(data.draw(numbers), nan=0.5, posinf=np.inf, neginf=-np.inf)
    poses[0, 2] = np.nan
    trajectory = Trajectory(time_ns=time_ns, poses=poses)
    write_trajectory(trajectory, folder / "any.csv", force=True)
    back = read_trajectory(folder / "any.csv")
    np.testing.assert_array_equal(back.time_ns, time_ns)
    np.testing.assert_array_equal(back.poses, poses)


@given(STAMPS, st.data())
def test_every_stamp_and_position_survives_tum(folder, time_ns, data):
    poses = data.draw(arrays.arrays(float, (len(time_ns), 3), elements=FINITE))
    poses[:, 2] = data.draw(arrays.arrays(float, len(time_ns), elements=st.floats(-np.pi, np.pi)))
    write_trajectory(Trajectory(time_ns=time_ns, poses=poses), folder / "any.tum", force=True)
    back = read_trajectory(folder / "any.tum")
    np.testing.assert_array_equal(back.time_ns, time_ns)
    np.testing.assert_array_equal(back.poses[:, :2], poses[:, :2])
    turned = np.abs(np.exp(1j * back.poses[:, 2]) - np.exp(1j * poses[:, 2]))
    assert turned.max() < 1e-15


def test_a_number_is_written_alike_beside_nan(folder):
    """So that a file is the same however many rows are written at a time."""
    poses = np.array([[1e22, 1e-7, 0.0], [np.nan, -np.inf, 5e-324]])
    write_trajectory(Trajectory(time_ns=[0, 1], poses=poses), folder / "nan.csv", force=True)
    write_trajectory(Trajectory(time_ns=[0], poses=poses[:1]), folder / "plain.csv", force=True)
    plain, whole = ((folder / f"{name}.csv").read_text().splitlines() for name in ("plain", "nan"))
    assert whole[:2] == plain
    assert whole[2] == "1,nan,-inf,5e-324"


def test_evo_reads_what_we_write(folder):
    file_interface = pytest.importorskip("evo.tools.file_interface")
    trajectory = circle()
    write_trajectory(trajectory, folder / "evo.tum", force=True)
    theirs = file_interface.read_tum_trajectory_file(folder / "evo.tum")
    np.testing.assert_allclose(theirs.timestamps, trajectory.time_ns * 1e-9, rtol=1e-15)
    np.testing.assert_array_equal(theirs.positions_xyz[:, :2], trajectory.poses[:, :2])
    yaw = [np.arctan2(pose[1, 0], pose[0, 0]) for pose in theirs.poses_se3]
    np.testing.assert_allclose(np.exp(1j * np.array(yaw)), np.exp(1j * trajectory.poses[:, 2]), atol=1e-15)


def test_tum_of_others_is_read(folder):
    path = folder / "others.tum"
    half = np.sqrt(0.5)
    path.write_text(
        f"# time x y z qx qy qz qw\n1.5 1 2 9 0 0 {half} {half}\n 2e0\t3 4 9 0 0 2 0\n3 5 6 9 0 0 0 0\n"
    )
    back = read_trajectory(path)
    assert back.time_ns.tolist() == [1_500_000_000, 2_000_000_000]
    np.testing.assert_allclose(back.poses, [[1, 2, np.pi / 2], [3, 4, np.pi]])
    assert back.rejected == {"nonfinite": 1}


def test_csv_of_others_is_read(folder):
    path = folder / "others.csv"
    path.write_text("time,y,x,note\n1.5,2,1,hello\n2,4,x,there\n2.5,6,5,\n")
    back = read_trajectory(path)
    assert back.time_ns.tolist() == [1_500_000_000, 2_500_000_000]
    np.testing.assert_array_equal(back.poses, [[1, 2, np.nan], [5, 6, np.nan]])
    assert dict(back.rejected) == {"parse": 1}


# ------------------------------------------------------------------------- what is refused


def test_unknown_suffixes_name_the_known_ones(folder):
    with pytest.raises(InputError, match=r"'\.txt'; known: \.tum, \.csv, \.parquet"):
        write_trajectory(circle(), folder / "run.txt")
    with pytest.raises(LogError, match=r"'\.txt'; known: \.tum, \.csv, \.parquet"):
        read_trajectory(folder / "run.txt")


def test_tum_cannot_hold_an_unknown_heading(folder):
    poses = np.array([[1.0, 2.0, 0.0], [1.0, 2.0, np.nan]])
    with pytest.raises(InputError, match=r"pose 1 .* \.csv can hold it"):
        write_trajectory(Trajectory(time_ns=np.arange(2), poses=poses), folder / "nan.tum")
    assert not (folder / "nan.tum").exists()


def test_half_a_covariance_is_refused(folder):
    path = folder / "half.csv"
    path.write_text("time_ns,x,y,covariance.xx\n1,2,3,4\n")
    with pytest.raises(LogSchema, match=r"covariance\.xy"):
        read_trajectory(path)


# ---------------------------------------------------------------------------- atomic files

OLD, NEW = b"the old file\n", b"the new file, complete\n"


def leftovers(folder: Path) -> list[str]:
    return [path.name for path in folder.iterdir() if path.name.startswith(".trundle-")]


def in_another_process(
    program: str, *arguments: str, **environment: str
) -> subprocess.CompletedProcess[bytes]:
    prelude = (
        "import os, signal, sys, resource\n"
        "from pathlib import Path\n"
        "from trundle.adapters.atomic import atomic_path\n"
    )
    command = [sys.executable, "-c", prelude + program, *arguments]
    return subprocess.run(command, capture_output=True, check=False, env=os.environ | environment)


def killed_in_the_middle(folder):
    """Killed while the new file is half written: the old one stands."""
    (folder / "out").write_bytes(OLD)
    program = """
with atomic_path(sys.argv[1], force=True) as path:
    with path.open("wb") as file:
        file.write(b"half")
        file.flush()
        os.kill(os.getpid(), signal.SIGKILL)
"""
    assert in_another_process(program, str(folder / "out")).returncode == -signal.SIGKILL
    assert (folder / "out").read_bytes() == OLD


def killed_before_the_last_step(folder):
    """Killed when the new file is whole but has not its name yet: the old one stands."""
    (folder / "out").write_bytes(OLD)
    program = """
Path.replace = lambda *_: os.kill(os.getpid(), signal.SIGKILL)
with atomic_path(sys.argv[1], force=True) as path:
    path.write_bytes(b"new")
"""
    assert in_another_process(program, str(folder / "out")).returncode == -signal.SIGKILL
    assert (folder / "out").read_bytes() == OLD


def killed_after_the_last_step(folder):
    """Killed as soon as the new file has its name: it is complete."""
    (folder / "out").write_bytes(OLD)
    program = """
def replace(path, target, old=Path.replace):
    old(path, target)
    os.kill(os.getpid(), signal.SIGKILL)
Path.replace = replace
with atomic_path(sys.argv[1], force=True) as path:
    path.write_bytes(sys.argv[2].encode())
"""
    killed = in_another_process(program, str(folder / "out"), NEW.decode())
    assert killed.returncode == -signal.SIGKILL
    assert (folder / "out").read_bytes() == NEW
    assert leftovers(folder) == []


def interrupted(folder):
    """Ctrl-C: the old file stands and nothing else is left."""
    (folder / "out").write_bytes(OLD)

    def write() -> None:
        with atomic_path(folder / "out", force=True) as path:
            path.write_bytes(b"half")
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write()
    assert (folder / "out").read_bytes() == OLD
    assert leftovers(folder) == []


def disk_full(folder):
    """No room for the new file: the old one stands, nothing is left, and the error is ours."""
    (folder / "out").write_bytes(OLD)
    program = """
from trundle.errors import OutputError
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))
try:
    with atomic_path(sys.argv[1], force=True) as path:
        path.write_bytes(bytes(100_000))
except OutputError as error:
    assert "File too large" in str(error), error
    sys.exit(5)
"""
    done = in_another_process(program, str(folder / "out"))
    assert done.returncode == 5, done.stderr
    assert (folder / "out").read_bytes() == OLD
    assert leftovers(folder) == []


def no_such_folder(folder):
    with pytest.raises(OutputError, match="No such file"):
        write_trajectory(circle(), folder / "missing" / "out.csv")


def not_writable(folder):
    with pytest.raises(OutputError, match=r"/proc/out\.csv: cannot be written"):
        write_trajectory(circle(), "/proc/out.csv")


def name_without_encoding(folder):
    """A name that is no UTF-8, in every format and in a C locale."""
    path = os.fsdecode(os.fsencode(folder) + b"/r\xe9sum\xff")
    suffixes = [".tum", ".csv", *([".parquet"] if importlib.util.find_spec("pyarrow") else [])]
    for suffix in suffixes:
        write_trajectory(circle(), path + suffix)
        np.testing.assert_array_equal(read_trajectory(path + suffix).time_ns, circle().time_ns)
    with pytest.raises(OutputError, match="exists"):
        write_trajectory(circle(), path + ".csv")


def locale_of_1970(folder):
    program = """
import numpy as np
from trundle.adapters.trajectory import read_trajectory, write_trajectory
from trundle.records import Trajectory
path = Path(os.fsdecode(os.fsencode(sys.argv[1]) + b"/\\xc3\\xa9\\xff.csv"))
write_trajectory(Trajectory(time_ns=np.arange(3), poses=np.eye(3)), path)
assert (read_trajectory(path).poses == np.eye(3)).all()
"""
    plain = {"LC_ALL": "C", "LANG": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"}
    done = in_another_process(program, str(folder), **plain)
    assert done.returncode == 0, done.stderr


def long_path(folder):
    """260 characters and more, and a name as long as the file system takes."""
    deep = folder / ("d" * 120) / ("e" * 120)
    deep.mkdir(parents=True)
    path = deep / ("f" * 251 + ".csv")
    write_trajectory(circle(), path)
    check_equal(read_trajectory(path), circle())


def existing_output(folder):
    (folder / "out.csv").write_bytes(OLD)
    with pytest.raises(OutputError, match=r"exists; it is replaced with force=True"):
        write_trajectory(circle(), folder / "out.csv")
    assert (folder / "out.csv").read_bytes() == OLD
    write_trajectory(circle(), folder / "out.csv", force=True)
    check_equal(read_trajectory(folder / "out.csv"), circle())


def output_is_input(folder):
    """By another name too: what a link points at is what exists."""
    write_trajectory(circle(), folder / "run.csv")
    before = (folder / "run.csv").read_bytes()
    (folder / "link.csv").symlink_to("run.csv")
    for name in ("run.csv", "link.csv"):
        with pytest.raises(OutputError, match="exists"):
            write_trajectory(circle(3), folder / name)
    assert (folder / "run.csv").read_bytes() == before


def born_meanwhile(folder):
    """A file that appears while ours is written is not overwritten."""

    def write() -> None:
        with atomic_path(folder / "out") as path:
            path.write_bytes(NEW)
            (folder / "out").write_bytes(OLD)

    with pytest.raises(OutputError, match="exists"):
        write()
    assert (folder / "out").read_bytes() == OLD


def no_file_at_all(folder):
    (folder / "out.csv").mkdir()
    with pytest.raises(OutputError, match="not a regular file"):
        write_trajectory(circle(), folder / "out.csv", force=True)


FAULTS = {
    "X1-disk-full": disk_full,
    "X1-no-folder": no_such_folder,
    "X1-not-writable": not_writable,
    "X2-middle": killed_in_the_middle,
    "X2-before": killed_before_the_last_step,
    "X2-after": killed_after_the_last_step,
    "X2-interrupt": interrupted,
    "X3-name": name_without_encoding,
    "X3-locale": locale_of_1970,
    "X3-long": long_path,
    "X4-existing": existing_output,
    "X4-input": output_is_input,
    "X4-meanwhile": born_meanwhile,
    "X4-folder": no_file_at_all,
}


@pytest.mark.parametrize("check", [pytest.param(check, id=row) for row, check in FAULTS.items()])
def test_fault(tmp_path, check):
    check(tmp_path)


def test_new_files_have_ordinary_rights_and_old_ones_keep_theirs(tmp_path):
    (tmp_path / "plain").touch()
    with atomic_path(tmp_path / "new"):
        pass
    assert (tmp_path / "new").stat().st_mode == (tmp_path / "plain").stat().st_mode
    (tmp_path / "new").chmod(0o640)
    with atomic_path(tmp_path / "new", force=True):
        pass
    assert (tmp_path / "new").stat().st_mode & 0o777 == 0o640


def test_links_are_followed(tmp_path):
    (tmp_path / "file").write_bytes(OLD)
    (tmp_path / "link").symlink_to("file")
    with atomic_path(tmp_path / "link", force=True) as path:
        path.write_bytes(NEW)
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "file").read_bytes() == NEW
