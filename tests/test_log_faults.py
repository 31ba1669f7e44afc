"""Logs out of order, logs that are unsafe to load, and files that change or fail while they are read."""

from __future__ import annotations

import importlib
import io
import os
import subprocess
import sys
import tarfile
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer
from rosbags.typesys import Stores, get_typestore

from trundle.adapters import log as log_door
from trundle.adapters.content import Content, content_of
from trundle.adapters.log import read_log
from trundle.adapters.stamp_order import MOST_LATE_NS, in_order
from trundle.adapters.table_log import read_table_log
from trundle.apps.cli import main
from trundle.errors import LogError
from trundle.odometry.integrate import integrate
from trundle.records import WheelLog
from trundle.robot import Differential

DRIVE = Differential(track_width=0.2, wheel_radius=0.04)
ROBOT = "drive: {type: differential, track_width: 0.2, wheel_radius: 0.04}\n"
HEADER = "time,left.position,right.position"


def drive(seconds: float = 2.0, rate: int = 50) -> np.ndarray:
    """Rows of a short, curved drive: time [s], left and right [rad]."""
    t = np.arange(round(seconds * rate)) / rate
    return np.stack([t, 5.0 * t, 6.0 * t + 0.3 * np.sin(3.0 * t)], axis=-1)


def csv(rows) -> str:
    return "\n".join([HEADER, *(",".join(repr(float(cell)) for cell in row) for row in rows)]) + "\n"


def write(folder: Path, content, name: str = "run.csv") -> Path:
    path = folder / name
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    return path


def same(one: WheelLog, other: WheelLog) -> bool:
    return np.array_equal(one.time_ns, other.time_ns) and np.array_equal(one.wheels, other.wheels)


def refuses(path: Path, reason: str, *words: str) -> None:
    with pytest.raises(LogError) as caught:
        read_log(path, DRIVE)
    assert caught.value.reason == reason
    assert all(word in str(caught.value) for word in (path.name, *words))


def track(folder: Path, log: Path, *words: str) -> int:
    robot = write(folder, ROBOT, "robot.yaml")
    return main(["track", str(log), "--robot", str(robot), "-o", str(folder / "out.csv"), *words])


# ------------------------------------------------------------------------------ the order of time


@given(st.lists(st.integers(0, MOST_LATE_NS), min_size=2, max_size=40), st.randoms())
def test_rows_within_the_window_are_sorted_and_ties_stay(late, random):
    """Every row arrives up to one second after its stamp; what is read is the stamps' own order, stably."""
    stamps = np.sort([random.randrange(0, 5 * MOST_LATE_NS, MOST_LATE_NS // 4) for _ in late])
    arrival = np.argsort(stamps + np.array(late), kind="stable")
    log = WheelLog(time_ns=stamps[arrival], wheel_names=("left",), wheels=arrival[:, None].astype(float))
    read = in_order(log)
    assert read.time_ns.tolist() == stamps.tolist()
    for stamp in set(stamps.tolist()):
        recorded = log.wheels[log.time_ns == stamp].tolist()
        assert read.wheels[read.time_ns == stamp].tolist() == recorded
    assert len(read.warnings) == (np.diff(log.time_ns) < 0).any()


def test_stamps_at_the_ends_of_all_time_do_not_overflow():
    ends = np.array([np.iinfo(np.int64).max, np.iinfo(np.int64).min])
    log = WheelLog(time_ns=ends, wheel_names=("left",), wheels=np.zeros((2, 1)), source="run")
    with pytest.raises(LogError, match=r"18446744073\.709551615 s before"):
        in_order(log)
    assert in_order(log, sort=True).time_ns.tolist() == ends[::-1].tolist()


def fault_shuffled(folder):
    """Rows up to a second late are put in order, and give what the log gives that was never shuffled."""
    rows = drive()
    shuffled = rows.copy()
    shuffled[[10, 11, 12]] = rows[[12, 10, 11]]
    shuffled[[30, 79]] = rows[[79, 30]]
    log = read_log(write(folder, csv(shuffled)), DRIVE)
    assert same(log, read_log(write(folder, csv(rows), "sorted.csv"), DRIVE))
    assert "0.98 s late; they were put in order" in log.warnings[-1]


def fault_unsorted(folder):
    """Beyond a second it is refused, and says where; `--sort` is what sorts it all the same."""
    rows = drive()
    log = write(folder, csv(np.roll(rows, -60, axis=0)))
    refuses(log, "unsorted", "row 40 is stamped 0 s, 1.98 s before", "--sort")
    assert track(folder, log) == 3
    assert track(folder, log, "--sort") == 0
    output = (folder / "out.csv").read_bytes()
    assert track(folder, write(folder, csv(rows), "sorted.csv"), "--force") == 0
    assert (folder / "out.csv").read_bytes() == output


def fault_counted(folder):
    """Duplicates and NaN are refused row by row, change nothing, and stand in the summary."""
    rows = drive()
    other = rows[20].copy()
    other[1] += 1.0
    nan, inf = rows[40] + 0.001, rows[60] + 0.001
    nan[1], inf[2] = np.nan, np.inf
    hostile = np.vstack([rows[:21], rows[20], other, rows[21:41], nan, rows[41:61], inf, rows[61:]])
    log = read_log(write(folder, csv(hostile)), DRIVE)
    trajectory = integrate(DRIVE, log)
    clean = integrate(DRIVE, read_log(write(folder, csv(rows), "clean.csv"), DRIVE))
    assert dict(trajectory.rejected) == {"duplicate": 1, "duplicate_conflict": 1, "nonfinite": 2}
    # A refused row makes `arc+` forget the step before it: a hair of the second order.
    np.testing.assert_allclose(trajectory.poses[-1], clean.poses[-1], atol=1e-6)


def fault_counted_by_command(folder, capsys):
    rows = drive()
    nan = [0.3501, np.nan, 1.0]
    log = write(folder, csv(np.vstack([rows[:10], rows[9], rows[10:18], nan, rows[18:]])))
    assert track(folder, log) == 0
    said = capsys.readouterr().out
    assert "100 of 102 accepted" in said
    assert "1 duplicate" in said
    assert "1 nonfinite" in said


# ----------------------------------------------------------------------------- unsafe to load


class Trap:
    """Unpickled, this would leave a file behind."""

    path = ""

    def __reduce__(self):
        return os.mkdir, (type(self).path,)


def saved(folder: Path, name: str = "run.npz", save=np.savez, **arrays) -> Path:
    save(folder / name, **arrays)
    return folder / name


def fault_objects(folder):
    """Arrays of Python objects are refused by their headers, wanted or not, and never loaded."""
    Trap.path = str(folder / "sprung")
    rows = drive()
    trap = np.array([Trap()], dtype=object)
    columns = {"time": rows[:, 0], "left.position": rows[:, 1], "right.position": rows[:, 2]}
    refuses(saved(folder, **columns, other=trap), "unsafe", "'other.npy' holds Python objects")
    refuses(saved(folder, **columns | {"left.position": trap}), "unsafe")
    np.save(folder / "run.npy", trap)
    refuses(folder / "run.npy", "unsafe")
    nested = np.zeros(1, dtype=[("a", "O")])
    refuses(saved(folder, **columns, nested=nested), "unsafe")
    assert not (folder / "sprung").exists()


def fault_pickles(folder):
    Trap.path = str(folder / "sprung")
    for protocol in range(importlib.import_module("pickle").HIGHEST_PROTOCOL + 1):
        content = importlib.import_module("pickle").dumps({"time": Trap()}, protocol=protocol)
        refuses(write(folder, content, "run.pkl"), "unsafe", "pickle")
        if protocol >= 2:
            refuses(write(folder, content, "run.csv"), "unsafe", "pickle")
    assert not (folder / "sprung").exists()


def fault_npz(folder):
    """What is safe in an npz is read as from any table."""
    rows = drive()
    csv_log = read_log(write(folder, csv(rows)), DRIVE)
    columns = {"time": rows[:, 0], "left.position": rows[:, 1], "right.position": rows[:, 2]}
    for save in (np.savez, np.savez_compressed):
        path = saved(folder, save=save, note=np.array("a word"), **columns)
        assert content_of(path) is Content.NPZ
        assert same(read_log(path, DRIVE), csv_log)
    refuses(saved(folder, **columns | {"left.position": rows[:5, 1]}), "type", "'left.position' 5")
    refuses(saved(folder, **columns | {"left.position": rows[:, 1].astype(str)}), "type", "must be numbers")
    path = saved(folder, **columns)
    whole = path.read_bytes()
    for cut in np.linspace(1, len(whole) - 1, 40).astype(int).tolist():
        path.write_bytes(whole[:cut])
        with pytest.raises(LogError):
            read_log(path, DRIVE)
    bomb = saved(folder, "bomb.npz", np.savez_compressed, **columns | {"left.position": np.zeros(1 << 24)})
    refuses(bomb, "limit", "would grow from")


# ------------------------------------------------------------------------------- unsafe paths

OUTSIDE = ("../../x", "/etc/x", "a/../../x", "..\\x", "C:\\x", "\\\\host\\share\\x")


def fault_archive_members(folder):
    for name in OUTSIDE:
        with zipfile.ZipFile(folder / "run.zip", "w") as archive:
            archive.writestr(zipfile.ZipInfo(name), "time\n")
        refuses(folder / "run.zip", "unsafe_path", repr(name))
        with tarfile.open(folder / "run.tar", "w") as archive:
            archive.addfile(tarfile.TarInfo(name), io.BytesIO())
        refuses(folder / "run.tar", "unsafe_path", repr(name))


def fault_archive_links(folder):
    link = zipfile.ZipInfo("run.csv")
    link.external_attr = 0o120777 << 16
    with zipfile.ZipFile(folder / "run.zip", "w") as archive:
        archive.writestr(link, "/etc/hostname")
    refuses(folder / "run.zip", "unsafe_path", "is a link")
    for kind in (tarfile.SYMTYPE, tarfile.LNKTYPE):
        member = tarfile.TarInfo("run.csv")
        member.type, member.linkname = kind, "/etc/hostname"
        with tarfile.open(folder / "run.tar", "w") as archive:
            archive.addfile(member)
        refuses(folder / "run.tar", "unsafe_path", "is a link")


def fault_nameless_member(folder):
    """A member without a name, which the zip module itself does not expect."""
    with zipfile.ZipFile(folder / "run.zip", "w") as archive:
        archive.writestr(zipfile.ZipInfo("x"), "time\n")
    path = folder / "run.zip"
    content = bytearray(path.read_bytes())
    entry = content.index(b"PK\x01\x02")
    content[entry + 28 : entry + 30] = b"\0\0"  # the length of its name
    content[entry + 30 : entry + 32] = b"\1\0"  # what was the name is an extra field
    path.write_bytes(content)
    with pytest.raises(LogError):
        read_log(path, DRIVE)


def fault_harmless_archives(folder):
    """Even a harmless archive is not unpacked: whose files they are is for a person to say."""
    with zipfile.ZipFile(folder / "run.zip", "w") as archive:
        archive.writestr("run.csv", csv(drive()))
    refuses(folder / "run.zip", "format", "zip archive of run.csv: unpack it")
    with tarfile.open(folder / "run.tar", "w") as archive:
        archive.addfile(tarfile.TarInfo("run.csv"), io.BytesIO())
    refuses(folder / "run.tar", "format", "tar archive of run.csv: unpack it")


def fault_named_by_metadata(folder):
    """Neither the metadata of a rosbag2 nor the manifest of a tub may lead out of their folder."""
    bag, tub = folder / "bag", folder / "tub"
    bag.mkdir()
    tub.mkdir()
    for name in ("../../x.db3", "/etc/x.db3"):
        write(bag, b"SQLite format 3\0", "x.db3")
        about = (
            f"rosbag2_bagfile_information: {{relative_file_paths: [{name}], topics_with_message_count: []}}"
        )
        write(bag, about, "metadata.yaml")
        refuses(bag, "unsafe_path", name)
        manifest = [
            "[]",
            "[]",
            "{}",
            "{}",
            f'{{"paths": ["{name}"], "current_index": 1, "deleted_indexes": []}}',
        ]
        write(tub, "\n".join(manifest) + "\n", "manifest.json")
        refuses(tub, "unsafe_path", name)


# ------------------------------------------------------- files that change, vanish or fail


def meanwhile(monkeypatch, action) -> None:
    """Have something happen while a table is read."""

    def read(path, robot, mapping, salvage):
        log = read_table_log(path, robot, mapping)
        time.sleep(0.02)  # systems stamp files by a clock of a few milliseconds
        action(path)
        return log

    monkeypatch.setitem(log_door._READERS, Content.TEXT, read)


def keep_times(path: Path, change) -> None:
    about = path.stat()
    change(path)
    os.utime(path, ns=(about.st_atime_ns, about.st_mtime_ns))


def replace(path: Path) -> None:
    other = path.with_name("other")
    other.write_bytes(path.read_bytes())
    other.replace(path)


def append(path: Path) -> None:
    with path.open("a") as file:
        file.write("9.0,9.0,9.0\n")


def overwrite(path: Path) -> None:
    content = path.read_bytes()
    with path.open("r+b") as file:
        file.write(content.replace(b"5", b"6"))


CHANGES = {
    "grows": (append, "bytes while it was read"),
    "shrinks": (lambda path: os.truncate(path, 100), "to 100 bytes while it was read"),
    "is-overwritten": (overwrite, "changed while it was read"),
    "keeps-its-times": (lambda path: keep_times(path, overwrite), "changed while it was read"),
    "is-replaced": (replace, "was replaced while it was read"),
    "vanishes": (Path.unlink, "vanished while it was read"),
}


def changing(name):
    def fault(folder, monkeypatch):
        action, words = CHANGES[name]
        meanwhile(monkeypatch, action)
        refuses(write(folder, csv(drive())), "changed", words)
        assert track(folder, write(folder, csv(drive()))) == 5
        assert not (folder / "out.csv").exists()

    return fault


def fault_mapped_shrinks(folder):
    """Reading behind the end of a mapped file would kill the process; so this is another process."""
    script = (
        "import os, sys\n"
        "from trundle.adapters.bag import open_bag\n"
        "from trundle.adapters.wpilog import open_wpilog\n"
        "from trundle.errors import LogError\n"
        "for path in sys.argv[1:]:\n"
        "    with (open_wpilog if path.endswith('.wpilog') else open_bag)(path) as recording:\n"
        "        os.truncate(path, 64)\n"
        "        for topic in recording.topics:\n"
        "            try:\n"
        "                recording.read(topic, [])\n"
        "            except LogError as error:\n"
        "                print('cut off while it was read' in str(error))\n"
    )
    log, robot = write(folder, csv(drive(200.0))), write(folder, ROBOT, "robot.yaml")
    outputs = [folder / "out.mcap", folder / "out.wpilog"]
    for output in outputs:
        assert main(["track", str(log), "--robot", str(robot), "-o", str(output)]) == 0
    outputs.append(write_ros1_bag(folder / "out.bag"))
    words = [sys.executable, "-c", script, *map(str, outputs)]
    done = subprocess.run(words, check=False, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert len(done.stdout.split()) >= len(outputs)
    assert set(done.stdout.split()) == {"True"}


def write_ros1_bag(path: Path) -> Path:
    store, kind = get_typestore(Stores.ROS1_NOETIC), "std_msgs/msg/Float64"
    with Writer(path) as writer:
        topic = writer.add_connection("/x", kind, typestore=store)
        for ns in range(1, 4000):
            writer.write(topic, ns, store.serialize_ros1(store.types[kind](float(ns)), kind))
    return path


def fault_growing_is_a_loss(folder, monkeypatch):
    """Of a log that is still being written, `--salvage` takes what is there, and says so."""
    meanwhile(monkeypatch, append)
    log = read_log(write(folder, csv(drive())), DRIVE, salvage=True)
    assert "what came later is lost" in log.losses[0]
    assert track(folder, write(folder, csv(drive())), "--salvage") == 4


def fault_io_error(folder):
    """A file that opens and cannot be read: here the first page of a process's own memory."""
    if not Path("/proc/self/mem").exists():
        pytest.skip("no /proc on this machine")
    (folder / "run.csv").symlink_to("/proc/self/mem")
    refuses(folder / "run.csv", "unreadable", "Input/output error")
    assert track(folder, folder / "run.csv") == 5


def fault_io_error_later(folder, monkeypatch):
    """The disk, or the server of a network file system, gives up halfway."""
    for number in (5, 116):  # EIO, ESTALE

        def fail(path, robot, mapping, salvage, number=number):
            raise OSError(number, os.strerror(number))

        monkeypatch.setitem(log_door._READERS, Content.TEXT, fail)
        refuses(write(folder, csv(drive())), "unreadable", os.strerror(number))
        assert track(folder, folder / "run.csv") == 5


def fault_permission(folder, monkeypatch):
    """A permission is refused by the system; that it is, does not hang on who runs this test."""
    path = write(folder, csv(drive()))

    def refuse(self, *args, **kwargs):
        if self == path:
            raise PermissionError(13, os.strerror(13), str(self))
        return opened(self, *args, **kwargs)

    opened = Path.open
    monkeypatch.setattr(Path, "open", refuse)
    refuses(path, "unreadable", "Permission denied")
    assert track(folder, path) == 5


# ------------------------------------------------------------------------------- the same bytes


def fault_same_bytes(folder):
    """One input, one output: in every format, whatever the hash seed and the number of cores."""
    log = write(folder, csv(drive()))
    robot = write(folder, ROBOT + "noise: {wheel_distance: 0.01}\n", "robot.yaml")
    outputs = ["tum", "csv", "parquet", "mcap", "wpilog"]
    script = (
        "import os, sys\n"
        "os.sched_setaffinity(0, set(sorted(os.sched_getaffinity(0))[: int(sys.argv[1])]))\n"
        "from trundle.apps.cli import main\n"
        "for suffix in sys.argv[5].split(','):\n"
        "    to = f'{sys.argv[4]}.{suffix}'\n"
        "    assert main(['track', sys.argv[2], '--robot', sys.argv[3], '-o', to]) == 0\n"
    )
    for cores, seed in (("1", "1"), ("2", "2")):
        words = [sys.executable, "-c", script, cores, str(log), str(robot), str(folder / f"out{cores}")]
        environment = os.environ | {"PYTHONHASHSEED": seed, "OMP_NUM_THREADS": cores}
        subprocess.run([*words, ",".join(outputs)], check=True, capture_output=True, env=environment)
    for suffix in outputs:
        one, two = ((folder / f"out{cores}.{suffix}").read_bytes() for cores in (1, 2))
        assert one
        assert one == two, suffix


FAULTS = {
    "L13-shuffled": fault_shuffled,
    "L13-unsorted": fault_unsorted,
    "L14": fault_counted,
    "L14-command": fault_counted_by_command,
    "L18-objects": fault_objects,
    "L18-pickles": fault_pickles,
    "L18-safe": fault_npz,
    "L19-members": fault_archive_members,
    "L19-links": fault_archive_links,
    "L19-harmless": fault_harmless_archives,
    "L19-nameless": fault_nameless_member,
    "L19-metadata": fault_named_by_metadata,
    **{f"D3-{name}": changing(name) for name in CHANGES},
    "D3-mapped": fault_mapped_shrinks,
    "D3-growing": fault_growing_is_a_loss,
    "D5-eio": fault_io_error,
    "D5-eio-later": fault_io_error_later,
    "D5-permission": fault_permission,
    "X5": fault_same_bytes,
}


@pytest.mark.parametrize("fault", [pytest.param(fault, id=row) for row, fault in FAULTS.items()])
def test_fault(fault, tmp_path, request):
    names = fault.__code__.co_varnames[1 : fault.__code__.co_argcount]
    fault(tmp_path, *(request.getfixturevalue(name) for name in names))
