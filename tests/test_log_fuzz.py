"""Whatever bytes a parser is given, it answers with a log or with an error of ours.

Here by chance, for a moment; `make verify` has fuzz_parser.py do it for a minute each.
"""

from __future__ import annotations

import contextlib
import random
import subprocess
import sys
import tempfile
import time
import zipfile
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from rosbags.rosbag1 import Writer as Writer1
from rosbags.rosbag2 import StoragePlugin, Writer
from rosbags.typesys import Stores, get_typestore

import trundle as tr
from trundle.adapters.bag import open_bag
from trundle.adapters.content import content_of
from trundle.adapters.log import read_log
from trundle.adapters.trajectory import read_trajectory
from trundle.adapters.tub import MANIFEST
from trundle.adapters.tub_log import write_tub_log
from trundle.adapters.wpilog import open_wpilog
from trundle.errors import TrundleError
from trundle.records import WheelLog

FUZZER = Path(__file__).with_name("fuzz_parser.py")
SECONDS = 60
ROUNDS = 250  # in `make test`
DRIVE = tr.Differential(track_width=0.2, wheel_radius=0.04)
STAMPS = np.arange(1, 13) * 20_000_000
TURNED = np.stack([np.linspace(0.0, 3.0, 12), np.linspace(0.0, 4.0, 12)], axis=-1)


def log() -> WheelLog:
    return WheelLog(time_ns=STAMPS, wheel_names=("left", "right"), wheels=TURNED)


def trajectory() -> tr.Trajectory:
    return tr.integrate(DRIVE, log())


# --------------------------------------------------------------------------------- seeds


def table(folder: Path) -> bytes:
    cells = [f"{ns * 1e-9},{left},{right}" for ns, (left, right) in zip(STAMPS, TURNED, strict=True)]
    return "\n".join(["time,left.position,right.position", *cells, ""]).encode()


def json_lines(folder: Path) -> bytes:
    rows = zip(STAMPS, TURNED, strict=True)
    return "".join(
        f'{{"time": {ns * 1e-9}, "left.position": {left}, "right": {{"position": {right}}}}}\n'
        for ns, (left, right) in rows
    ).encode()


def columns() -> dict[str, np.ndarray]:
    return {"time": STAMPS * 1e-9, "left.position": TURNED[:, 0], "right.position": TURNED[:, 1]}


def npz(folder: Path) -> bytes:
    np.savez(folder / "seed.npz", **columns())
    return (folder / "seed.npz").read_bytes()


def npy(folder: Path) -> bytes:
    np.save(folder / "seed.npy", TURNED[:, 0])
    return (folder / "seed.npy").read_bytes()


def parquet(folder: Path) -> bytes:
    import pyarrow as pa
    from pyarrow.parquet import write_table

    write_table(pa.table(columns()), folder / "seed.parquet")
    return (folder / "seed.parquet").read_bytes()


def written(suffix: str) -> Callable[[Path], bytes]:
    def seed(folder: Path) -> bytes:
        tr.write_trajectory(trajectory(), folder / f"seed{suffix}")
        return (folder / f"seed{suffix}").read_bytes()

    return seed


def motive(folder: Path) -> bytes:
    head = ["Format Version,1.23,Rotation Type,Quaternion,Length Units,Meters", ""]
    kinds = [("Type", "Rigid Body"), ("Name", "Robot"), ("ID", "1")]
    head += [f",{word}" + f",{each}" * 7 for word, each in kinds]
    head += [
        ",,Rotation,Rotation,Rotation,Rotation,Position,Position,Position",
        "Frame,Time (Seconds),X,Y,Z,W,X,Y,Z",
    ]
    rows = [f"{k},{k / 120},0,{0.01 * k},0,1,{0.1 * k},0.2,{-0.1 * k}" for k in range(12)]
    return "\r\n".join([*head, *rows, ""]).encode()


def joint_states(writer, store, serialize, kind: str = "sensor_msgs/msg/JointState") -> None:
    kinds = store.types
    topic = writer.add_connection("/joint_states", kind, typestore=store)
    sequence = {"seq": 0} if store.fielddefs["std_msgs/msg/Header"][1][0][0] == "seq" else {}
    for ns, turned in zip(STAMPS.tolist(), TURNED, strict=True):
        stamp = kinds["builtin_interfaces/msg/Time"](0, ns)
        header = kinds["std_msgs/msg/Header"](**sequence, stamp=stamp, frame_id="base")
        message = kinds[kind](header, ["left", "right"], turned, turned, np.zeros(0))
        writer.write(topic, ns, bytes(serialize(message, kind)))


def rosbag2(plugin: StoragePlugin) -> Callable[[Path], bytes]:
    def seed(folder: Path) -> bytes:
        store = get_typestore(Stores.ROS2_HUMBLE)
        with Writer(folder / "seed", version=9, storage_plugin=plugin) as writer:
            joint_states(writer, store, store.serialize_cdr)
        return next(path for path in (folder / "seed").iterdir() if path.suffix != ".yaml").read_bytes()

    return seed


def rosbag1(folder: Path) -> bytes:
    store = get_typestore(Stores.ROS1_NOETIC)
    with Writer1(folder / "seed.bag") as writer:
        joint_states(writer, store, store.serialize_ros1)
    return (folder / "seed.bag").read_bytes()


def tub(folder: Path) -> bytes:
    write_tub_log(log(), folder / "seed", tr.Robot(drive=DRIVE))
    return b"\x00".join((folder / "seed" / name).read_bytes() for name in (MANIFEST, "catalog_0.catalog"))


# ------------------------------------------------------------------------------- parsers


def parse_log(path: Path) -> None:
    read_log(path, DRIVE)
    read_log(path, DRIVE, salvage=True, sort=True)


def parse_bag(path: Path) -> None:
    for salvage in (False, True):
        with open_bag(path, salvage=salvage) as bag:
            for topic in bag.topics:
                bag.read(topic, ["name", "position", "header.frame_id"])


def parse_wpilog(path: Path) -> None:
    for salvage in (False, True):
        with open_wpilog(path, salvage=salvage) as recording:
            for topic in recording.topics:
                with contextlib.suppress(TrundleError):  # texts are no columns
                    recording.read(topic, [])
    read_trajectory(path)


def parse_npy(path: Path) -> None:
    """An array within an archive whose checksums are right."""
    archive = path.with_suffix(".npz")
    with zipfile.ZipFile(archive, "w") as file:
        for name in columns():
            file.write(path, f"{name}.npy")
    read_log(archive, DRIVE)


def parse_tub(path: Path) -> None:
    manifest, _, catalog = path.read_bytes().partition(b"\x00")
    folder = path.with_suffix(".tub")
    folder.mkdir(exist_ok=True)
    (folder / MANIFEST).write_bytes(manifest)
    (folder / "catalog_0.catalog").write_bytes(catalog)
    content_of(folder)
    read_log(folder, DRIVE)


PARSERS: dict[str, tuple[str, Callable[[Path], bytes], Callable[[Path], object]]] = {
    "csv": (".csv", table, parse_log),
    "json": (".jsonl", json_lines, parse_log),
    "npz": (".npz", npz, parse_log),
    "npy": (".npy", npy, parse_npy),
    "parquet": (".parquet", parquet, parse_log),
    "mcap": (".mcap", rosbag2(StoragePlugin.MCAP), parse_bag),
    "mcap-trajectory": (".mcap", written(".mcap"), read_trajectory),
    "sqlite3": (".db3", rosbag2(StoragePlugin.SQLITE3), parse_bag),
    "rosbag1": (".bag", rosbag1, parse_bag),
    "wpilog": (".wpilog", written(".wpilog"), parse_wpilog),
    "tum": (".tum", written(".tum"), read_trajectory),
    "csv-trajectory": (".csv", written(".csv"), read_trajectory),
    "json-trajectory": (".jsonl", written(".jsonl"), read_trajectory),
    "kitti": (".kitti", written(".kitti"), read_trajectory),
    "euroc": (".euroc", written(".euroc"), read_trajectory),
    "motive": (".csv", motive, read_trajectory),
    "tub": ("", tub, parse_tub),
}


@cache
def seed_of(name: str) -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        return PARSERS[name][1](Path(folder))


class Target:
    """One parser, and what became of what it was given.

    Attributes:
        runs: How many inputs.
        refused: How many of them with an error of ours.
        slowest: The longest that one took [s].
    """

    def __init__(self, name: str, folder: Path) -> None:
        suffix, _, self.parse = PARSERS[name]
        self.path = folder / f"input{suffix}"
        self.slowest = 0.0
        self.runs = self.refused = 0

    def __call__(self, content: bytes) -> None:
        self.path.write_bytes(content)
        begin = time.perf_counter()
        self.runs += 1
        try:
            self.parse(self.path)
        except TrundleError:
            self.refused += 1
        self.slowest = max(self.slowest, time.perf_counter() - begin)

    def __str__(self) -> str:
        return (
            f"{self.runs} inputs, {self.refused} of them refused, the slowest in {self.slowest * 1e3:.0f} ms"
        )


def mutations(seed: bytes, chance: random.Random) -> Iterator[bytes]:
    """The seed with a few things changed, without end."""
    telling = [
        b"\0",
        b"\xff",
        b"\x7f\xff\xff\xff",
        b"\xff" * 8,
        b"\n",
        b",",
        b"nan",
        b'"',
        b"{",
        b"1e999",
        b"-1",
    ]
    while True:
        content = bytearray(seed)
        for _ in range(chance.choice((1, 1, 2, 5))):
            at = chance.randrange(len(content) + 1)
            to = min(len(content), at + chance.choice((1, 4, 8, chance.randrange(1, 200))))
            match chance.randrange(6):
                case 0 if at < len(content):
                    content[at] ^= 1 << chance.randrange(8)
                case 1:
                    del content[at:to]
                case 2:
                    content[at:at] = content[at:to]
                case 3:
                    word = chance.choice(telling)
                    content[at : at + len(word)] = word
                case 4:
                    content[at:to] = chance.randbytes(to - at)
                case 5 if chance.random() < 0.2:
                    del content[at:]
        yield bytes(content)


@pytest.mark.parametrize("name", PARSERS)
def test_seeds_are_read(name, tmp_path):
    target = Target(name, tmp_path)
    target(seed_of(name))
    assert target.refused == 0


@pytest.mark.parametrize("name", PARSERS)
def test_changed_bytes_give_a_log_or_an_error_of_ours(name, tmp_path):
    target, changed = Target(name, tmp_path), mutations(seed_of(name), random.Random(5))
    for _ in range(ROUNDS):
        target(next(changed))
    assert target.refused > 0


@pytest.mark.verify
@pytest.mark.parametrize("name", PARSERS)
def test_fuzzed_for_a_minute(name):
    done = subprocess.run(
        [sys.executable, FUZZER, name, str(SECONDS)], check=False, capture_output=True, text=True
    )
    counted = [line for line in done.stderr.splitlines() if line.startswith("Done ")]
    print(done.stdout.strip() or f"{name} by atheris: {' '.join(counted)}")
    assert done.returncode == 0, done.stderr[-3000:]
