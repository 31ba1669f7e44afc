"""Large logs, bombs and cut tables: what they take, and what is left of them."""

from __future__ import annotations

import bz2
import io
import json
import sqlite3
import struct
import subprocess
import sys
import zipfile
import zlib
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from backports import zstd
from lz4 import frame
from rosbags.typesys import Stores, get_typestore

from trundle.adapters.log import read_log
from trundle.adapters.mcap_writer import Channel, McapWriter
from trundle.apps.cli import main
from trundle.errors import LogError, LogTruncated
from trundle.robot import Differential

MOST_MEMORY = 300  # MiB
MOST_SECONDS = 2.0
DRIVE = Differential(track_width=0.2, wheel_radius=0.04)
ROBOT = """\
drive: {type: differential, track_width: 0.2, wheel_radius: 0.04}
log:
  wheels:
    left: {topic: /joint_states, name: left}
    right: {topic: /joint_states, name: right}
"""
# A process of its own says what its work took: the greatest part of memory that was ever resident.
MEASURED = """\
import json, sys, time
from trundle.apps.cli import main
begin = time.perf_counter()
code = main(sys.argv[1:])
took = time.perf_counter() - begin
peak = next(int(line.split()[1]) / 1024 for line in open("/proc/self/status") if line.startswith("VmHWM"))
print("\\n" + json.dumps([int(code), took, peak]), file=sys.stderr)
"""


def measured(*words: object) -> tuple[int, float, float, str]:
    """Exit code, seconds and peak memory [MiB] of a command, and what it said on stderr."""
    done = subprocess.run(
        [sys.executable, "-c", MEASURED, *map(str, words)], check=False, capture_output=True, text=True
    )
    *said, figures = done.stderr.strip().splitlines()
    return *json.loads(figures), "\n".join(said)


# ---------------------------------------------------------------------------------- large logs


@pytest.mark.verify
def test_four_gigabytes_are_read_chunk_by_chunk(tmp_path):
    """A thousand chunks of images, a hundred joint states in each."""
    if not Path("/proc/self/status").exists():
        pytest.skip("no /proc on this machine")
    recording, robot = tmp_path / "run.mcap", tmp_path / "robot.yaml"
    robot.write_text(ROBOT)
    size = write_recording(recording, chunks=1000, image_bytes=4_200_000)
    try:
        for words in (
            ["info", recording],
            ["track", recording, "--robot", robot, "-o", tmp_path / "out.tum"],
        ):
            code, seconds, peak, said = measured(*words)
            print(f"{words[0]} of {size / 1e9:.2f} GB of MCAP: {seconds:.1f} s, {peak:.0f} MiB at most")
            assert code == 0, said
            assert peak < MOST_MEMORY
        with (tmp_path / "out.tum").open() as file:
            assert sum(1 for _ in file) >= 100_000
    finally:
        recording.unlink()


def joint_state(distribution: Stores) -> tuple[np.ndarray, Callable[[np.ndarray, np.ndarray], np.ndarray]]:
    """The bytes of a message, and what makes so many rows of them the messages of these numbers."""
    store, kind, sec, nanosec = (
        get_typestore(distribution),
        "sensor_msgs/msg/JointState",
        0x1234567,
        0x89ABCDE,
    )
    stamp = store.types["builtin_interfaces/msg/Time"](sec, nanosec)
    sequence = (0,) if distribution is Stores.ROS1_NOETIC else ()
    head = store.types["std_msgs/msg/Header"](*sequence, stamp, "base_link")
    message = store.types[kind](head, ["left", "right"], np.array([1e9, 2e9]), np.zeros(0), np.zeros(0))
    serialize = store.serialize_ros1 if sequence else store.serialize_cdr
    one = bytes(serialize(message, kind))
    stamp_at = one.find(struct.pack("<II", sec, nanosec))
    places = [one.find(struct.pack("<d", value)) for value in (1e9, 2e9)]

    def changed(rows: np.ndarray, k: np.ndarray) -> np.ndarray:
        stamps = 10**18 + 10_000_000 * k
        header = np.stack([stamps // 10**9, stamps % 10**9], axis=-1).astype("<u4")
        rows[:, stamp_at : stamp_at + 8] = header.view(np.uint8)
        for place, rate in zip(places, (0.05, 0.06), strict=True):
            rows[:, place : place + 8] = (rate * k).astype("<f8")[:, None].view(np.uint8)
        return rows

    return np.frombuffer(one, np.uint8), changed


def write_joints(path: Path, chunks: int = 400, count: int = 10_000) -> None:
    """Joint states that differ in their numbers only: one is written over and over."""
    one, change = joint_state(Stores.ROS2_HUMBLE)
    before = np.frombuffer(record(0x05, struct.pack("<HIQQ", 1, 0, 0, 0) + one.tobytes())[:31], np.uint8)
    kind = "sensor_msgs/msg/JointState"
    schema = get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(kind, ros_version=2)[0]
    with path.open("wb") as file, McapWriter(file, [Channel("/joint_states", kind, schema)]) as writer:
        for chunk in range(chunks):
            k = np.arange(chunk * count, (chunk + 1) * count)
            stamps = 10**18 + 10_000_000 * k
            heads = np.tile(before, (count, 1))
            heads[:, 15:23] = heads[:, 23:31] = stamps.astype("<u8")[:, None].view(np.uint8)
            rows = np.concatenate([heads, change(np.tile(one, (count, 1)), k)], axis=1)
            writer.add(rows.tobytes(), {1: (stamps, rows.shape[1] * np.arange(count))})


def write_recording(path: Path, chunks: int, image_bytes: int) -> int:
    store = get_typestore(Stores.ROS2_HUMBLE)
    kinds = {"/joint_states": "sensor_msgs/msg/JointState", "/image": "sensor_msgs/msg/CompressedImage"}
    channels = [
        Channel(topic, kind, store.generate_msgdef(kind, ros_version=2)[0]) for topic, kind in kinds.items()
    ]
    stamp, header = store.types["builtin_interfaces/msg/Time"], store.types["std_msgs/msg/Header"]
    joint_state = store.types[kinds["/joint_states"]]
    noise = np.random.default_rng(0).integers(0, 256, image_bytes + chunks, dtype=np.uint8).tobytes()
    with path.open("wb") as file, McapWriter(file, channels) as writer:
        for chunk in range(chunks):
            records, stamps, starts = b"", [], []
            for k in range(100 * chunk, 100 * (chunk + 1)):
                ns = 10**18 + 10_000_000 * k
                head = header(stamp(ns // 10**9, ns % 10**9), "base_link")
                turned = np.array([0.05 * k, 0.06 * k])
                message = joint_state(head, ["left", "right"], turned, turned, np.zeros(0))
                starts.append(len(records))
                stamps.append(ns)
                cdr = bytes(store.serialize_cdr(message, kinds["/joint_states"]))
                records += record(0x05, struct.pack("<HIQQ", 1, k, ns, ns) + cdr)
            image = (
                struct.pack("<BBHiII", 0, 1, 0, 0, 0, 1)
                + b"\0" * 4
                + words(b"\0")
                + bytes(3)
                + words(noise[chunk:][:image_bytes])
            )
            image_at = len(records)
            records += record(0x05, struct.pack("<HIQQ", 2, chunk, ns, ns) + image)
            writer.add(
                records, {1: (np.array(stamps), np.array(starts)), 2: (np.array([ns]), np.array([image_at]))}
            )
    return path.stat().st_size


# --------------------------------------------------------------------------------------- bombs


def words(text: bytes) -> bytes:
    return struct.pack("<I", len(text)) + text


def record(op: int, content: bytes) -> bytes:
    return struct.pack("<BQ", op, len(content)) + content


def mcap(*records: bytes) -> bytes:
    return b"\x89MCAP0\r\n" + record(0x01, words(b"") * 2) + b"".join(records)


def mcap_chunk(stored: bytes, compression: bytes, size: int) -> bytes:
    fields = struct.pack("<QQQI", 1, 2, size, 0) + words(compression) + struct.pack("<Q", len(stored))
    return record(0x06, fields + stored)


def field(name: bytes, value: bytes) -> bytes:
    return words(name + b"=" + value)


def rosbag1(stored: bytes, compression: bytes, size: int) -> bytes:
    begin = words(field(b"op", b"\x03") + field(b"index_pos", bytes(8)) + field(b"conn_count", bytes(4)))
    chunk = (
        field(b"op", b"\x05") + field(b"compression", compression) + field(b"size", struct.pack("<I", size))
    )
    return b"#ROSBAG V2.0\n" + begin + words(b" " * 16) + words(chunk) + words(stored)


def npz_bomb() -> bytes:
    file = io.BytesIO()
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("time.npy", "w") as member:
        header = repr({"descr": "<f8", "fortran_order": False, "shape": (1 << 27,)}).encode()
        member.write(b"\x93NUMPY\1\0" + struct.pack("<H", len(header)) + header)
        for _ in range(1 << 10):
            member.write(bytes(1 << 20))
    return file.getvalue()


GIB = 1 << 30


def zeros(compressor) -> bytes:
    """A gigabyte of zeros, compressed."""
    return b"".join([compressor.compress(bytes(1 << 20)) for _ in range(1 << 10)]) + compressor.flush()


def lz4_zeros() -> bytes:
    compressor = frame.LZ4FrameCompressor()
    return compressor.begin() + zeros(compressor)


BOMBS = {
    "mcap-zstd.mcap": lambda: mcap(mcap_chunk(zeros(zstd.ZstdCompressor()), b"zstd", GIB)),
    "mcap-zstd-lies.mcap": lambda: mcap(mcap_chunk(zeros(zstd.ZstdCompressor()), b"zstd", 1000)),
    "mcap-lz4.mcap": lambda: mcap(mcap_chunk(lz4_zeros(), b"lz4", GIB)),
    "mcap-many.mcap": lambda: mcap(*[mcap_chunk(zstd.compress(bytes(1 << 20)), b"zstd", 1 << 20)] * 4000),
    "mcap-record.mcap": lambda: mcap(struct.pack("<BQ", 0x06, 4 << 30)),
    "mcap-schema.mcap": lambda: mcap(record(0x03, struct.pack("<HI", 1, 0xFFFFFFFF))),
    "file.mcap.zstd": lambda: zeros(zstd.ZstdCompressor()),
    "rosbag1-bz2.bag": lambda: rosbag1(zeros(bz2.BZ2Compressor()), b"bz2", GIB),
    "rosbag1-lz4.bag": lambda: rosbag1(lz4_zeros(), b"lz4", GIB),
    "rosbag1-record.bag": lambda: b"#ROSBAG V2.0\n" + struct.pack("<I", 0xFFFFFFFF),
    "zeros.npz": npz_bomb,
    "line.csv": lambda: b"time,left.position,right.position\n" + b"1" * (64 << 20),
    "columns.csv": lambda: b"," * (64 << 20),
    "deep.jsonl": lambda: b'{"time":' + b"[" * 1_000_000 + b"\n",
    "long.jsonl": lambda: b'{"time": "' + b"x" * (64 << 20),
    "wpilog-record.wpilog": lambda: b"WPILOG\0\1\0\0\0\0\xff" + b"\xff" * 16,
}


@pytest.mark.verify
@pytest.mark.parametrize("name", BOMBS)
def test_bombs_are_refused_at_once(name, tmp_path):
    robot, log = tmp_path / "robot.yaml", tmp_path / name
    is_table = log.suffix in (".csv", ".jsonl", ".npz")
    robot.write_text(ROBOT.partition("log:")[0] if is_table else ROBOT)
    log.write_bytes(BOMBS[name]())
    for way in ([], ["--salvage"]):
        code, seconds, peak, said = measured("track", log, "--robot", robot, "-o", tmp_path / "out.tum", *way)
        words = said.replace(str(tmp_path), "")[:150]
        print(f"{log.stat().st_size} bytes: {seconds:.2f} s, {peak:.0f} MiB: {words}")
        assert code == 3, said
        assert "internal error" not in said
        assert peak < MOST_MEMORY
        assert seconds < MOST_SECONDS


@pytest.mark.verify
def test_what_is_just_allowed_fits_into_memory(tmp_path):
    """Sixteen chunks, as large as they may be and growing as much as they may, come a few at a time."""
    robot, log = tmp_path / "robot.yaml", tmp_path / "run.mcap"
    robot.write_text(ROBOT)
    content = record(0x80, bytes(62 << 20) + np.random.default_rng(0).bytes(700_000))
    log.write_bytes(mcap(*[mcap_chunk(zstd.compress(content), b"zstd", len(content))] * 16))
    words = ["track", log, "--robot", robot, "-o", tmp_path / "out.tum", "--salvage"]
    _, seconds, peak, _ = measured(*words)
    print(f"{log.stat().st_size} bytes that grow to 1 GiB: {seconds:.2f} s, {peak:.0f} MiB")
    assert peak < MOST_MEMORY


# ---------------------------------------------------------------------------------- cut tables


def table(rows: int) -> list[bytes]:
    time = np.arange(rows) * 0.02
    turned = np.stack([5.0 * time, 6.0 * time + np.sin(time)], axis=-1)
    cells = [
        f"{t:.2f},{left!r},{right!r}\n"
        for t, (left, right) in zip(time.tolist(), turned.tolist(), strict=True)
    ]
    return [line.encode() for line in ("time,left.position,right.position\n", *cells)]


def is_row(line: bytes) -> bool:
    """Whether a line that does not end may be a whole row: three numbers."""
    cells = line.split(b",")
    try:
        return len(cells) == 3 and bool([float(cell) for cell in cells])
    except ValueError:
        return False


def check_cut(path: Path, lines: list[bytes], cut: int, *, refused: bool = True) -> None:
    """Of a table that is cut anywhere, every row that ends is read, and what is left of one more is named."""
    ends = np.cumsum([len(line) for line in lines])
    whole = int(np.searchsorted(ends, cut, side="right")) - 1  # rows below the header
    path.write_bytes(b"".join(lines)[:cut])
    if whole < 1:
        with pytest.raises(LogError):
            read_log(path, DRIVE)
        return
    torn = path.read_bytes().rpartition(b"\n")[2]
    if refused and torn and not is_row(torn):
        with pytest.raises(LogTruncated, match=f"ends at byte {cut}, inside line {whole + 2}"):
            read_log(path, DRIVE)
    log = read_log(path, DRIVE, salvage=bool(torn) and not is_row(torn))
    assert len(log) == whole
    expected = [[float(cell) for cell in line.split(b",")] for line in lines[1 : whole + 1]]
    assert log.wheels.tolist() == [row[1:] for row in expected]
    is_cut = cut not in ends
    assert bool(log.losses) == is_cut
    assert dict(log.rejected) == ({"unfinished": 1} if is_cut else {})
    assert any("the file ends inside it" in warning for warning in log.warnings) == is_cut


def test_cut_tables_lose_no_row_that_ends(tmp_path):
    lines = table(100)
    for cut in np.random.default_rng(0).choice(sum(map(len, lines)), 200, replace=False).tolist():
        check_cut(tmp_path / "cut.csv", lines, cut)


@pytest.mark.parametrize(
    ("name", "cut", "codes"),
    [
        pytest.param("run.csv", 0, (0, 0), id="L2-text-whole"),
        pytest.param("run.csv", 1, (4, 4), id="L2-text-perhaps"),
        pytest.param("run.csv", 25, (3, 4), id="L2-text"),
        pytest.param("run.jsonl", 1, (0, 0), id="L2-json-whole"),
        pytest.param("run.jsonl", 2, (3, 4), id="L2-json"),
    ],
)
@pytest.mark.parametrize("long", [1, 1 << 30], ids=["pieces", "whole"])
def test_cut_tables_by_command(name, cut, codes, long, tmp_path, monkeypatch, capsys):
    """Refused where rows are certainly missing; with `--salvage`, and where one may be, exit code 4."""
    monkeypatch.setattr("trundle.adapters.log.LONG", long)
    lines = table(100)
    if name == "run.jsonl":
        keys, *rows = [line.decode().strip().split(",") for line in lines]
        objects = [dict(zip(keys, map(float, row), strict=True)) for row in rows]
        lines = [f"{json.dumps(one)}\n".encode() for one in objects]
    content = b"".join(lines)
    log, robot, output = tmp_path / name, tmp_path / "robot.yaml", tmp_path / "out.csv"
    log.write_bytes(content[: len(content) - cut])
    robot.write_text(ROBOT.partition("log:")[0])
    for way, code in zip(([], ["--salvage"]), codes, strict=True):
        assert main(["track", str(log), "--robot", str(robot), "-o", str(output), "--force", *way]) == code
        assert output.exists() == (code != 3)
        said = capsys.readouterr().err
        assert (f"ends at byte {len(content) - cut}" in said) == (code != 0)
    assert main(["info", str(log)]) == codes[1]
    if codes[1]:
        assert len(output.read_text().splitlines()) == 100


@pytest.mark.verify
def test_tables_cut_at_every_byte(tmp_path):
    lines = table(1600)
    size = sum(map(len, lines))
    assert size > 50_000
    for cut in range(size):
        check_cut(tmp_path / "cut.csv", lines, cut, refused=not cut % 10)  # which takes as long again
    print(f"{size} cuts of a table of {size} bytes: every row that ended was read, every other one was named")


def check_flip(path: Path, whole: bytes, bit: int) -> str:
    """No row goes without a word: it is read or counted, or the file is refused. (A 3 may become a #.)"""
    flipped = bytearray(whole)
    flipped[bit // 8] ^= 1 << bit % 8
    path.write_bytes(flipped)
    try:
        log = read_log(path, DRIVE)
    except LogError:
        return "refused"
    lines = [line for line in bytes(flipped).split(b"\n") if line and not line.startswith(b"#")]
    assert len(log) + sum(log.rejected.values()) == len(lines) - 1
    return "counted" if log.rejected else "a number of its own"


@pytest.mark.verify
def test_ten_thousand_flips_of_a_table(tmp_path):
    whole = b"".join(table(1600))
    outcomes = [
        check_flip(tmp_path / "flip.csv", whole, bit)
        for bit in np.random.default_rng(0).choice(8 * len(whole), 10_000, replace=False).tolist()
    ]
    print({outcome: outcomes.count(outcome) for outcome in sorted(set(outcomes))})


def write_rows(path: Path) -> None:
    with path.open("w") as file:
        file.write("time,left.position,right.position\n")
        file.writelines(f"{k * 0.02:.2f},{k * 0.1:.3f},{k * 0.11:.3f}\n" for k in range(4_000_000))


def write_objects(path: Path) -> None:
    with path.open("w") as file:
        file.writelines(
            f'{{"time": {k * 0.02:.2f}, "left.position": {k * 0.1:.3f}, "right.position": {k * 0.11:.3f}}}\n'
            for k in range(4_000_000)
        )


def write_parquet(path: Path) -> None:
    pa, parquet = pytest.importorskip("pyarrow"), pytest.importorskip("pyarrow.parquet")
    names = ("time", "left.position", "right.position")
    schema = pa.schema([(name, pa.float64()) for name in names])
    with parquet.ParquetWriter(path, schema) as writer:
        for start in range(0, 4_000_000, 1_000_000):
            k = np.arange(start, start + 1_000_000)
            columns = [pa.array(k * rate) for rate in (0.02, 0.1, 0.11)]
            writer.write_table(pa.Table.from_arrays(columns, schema=schema))


def write_loose(path: Path) -> None:
    """An MCAP without chunks, under one checksum."""
    one, change = joint_state(Stores.ROS2_HUMBLE)
    kind, crc = "sensor_msgs/msg/JointState", 0
    schema, _ = get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(kind, ros_version=2)
    schema_record = struct.pack("<H", 1) + words(kind.encode()) + words(b"ros2msg") + words(schema.encode())
    channel = struct.pack("<HH", 1, 1) + words(b"/joint_states") + words(b"cdr") + words(b"")
    before = np.frombuffer(record(0x05, struct.pack("<HIQQ", 1, 0, 0, 0) + one.tobytes())[:31], np.uint8)
    with path.open("wb") as file:
        content = mcap(record(0x03, schema_record), record(0x04, channel))
        for start in range(0, 4_000_000, 100_000):
            k = np.arange(start, start + 100_000)
            heads = np.tile(before, (len(k), 1))
            heads[:, 15:23] = heads[:, 23:31] = (
                (10**18 + 10_000_000 * k).astype("<u8")[:, None].view(np.uint8)
            )
            content += np.concatenate([heads, change(np.tile(one, (len(k), 1)), k)], axis=1).tobytes()
            crc = zlib.crc32(content, crc)
            file.write(content)
            content = b""
        file.write(record(0x0F, struct.pack("<I", crc)) + record(0x02, bytes(20)) + b"\x89MCAP0\r\n")


def write_database(path: Path) -> None:
    path.mkdir()
    one, change = joint_state(Stores.ROS2_HUMBLE)
    with sqlite3.connect(path / "run_0.db3") as database:
        database.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT)"
        )
        database.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        database.execute(
            "INSERT INTO topics VALUES (1, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr')"
        )
        for start in range(0, 4_000_000, 100_000):
            k = np.arange(start, start + 100_000)
            rows = change(np.tile(one, (len(k), 1)), k)
            database.executemany(
                "INSERT INTO messages (topic_id, timestamp, data) VALUES (1, ?, ?)",
                zip((10**18 + 10_000_000 * k).tolist(), map(bytes, rows), strict=True),
            )
    database.close()


def write_rosbag1(path: Path) -> None:
    """Chunks with an index each; at the end the connection, and what each chunk holds."""
    one, change = joint_state(Stores.ROS1_NOETIC)
    text, _ = get_typestore(Stores.ROS1_NOETIC).generate_msgdef("sensor_msgs/msg/JointState", ros_version=1)
    connection = words(
        field(b"op", b"\x07") + field(b"conn", bytes(4)) + field(b"topic", b"/joint_states")
    ) + words(
        field(b"topic", b"/joint_states")
        + field(b"type", b"sensor_msgs/JointState")
        + field(b"md5sum", b"*")
        + field(b"message_definition", text.encode())
    )
    head = words(field(b"op", b"\x02") + field(b"conn", bytes(4)) + field(b"time", bytes(8)))
    time_at = head.find(b"time=") + 5
    before = np.frombuffer(head + struct.pack("<I", len(one)), np.uint8)

    def opened(index_position: int) -> bytes:
        numbers = {b"index_pos": struct.pack("<Q", index_position), b"conn_count": struct.pack("<I", 1)}
        fields = b"".join(
            field(*pair) for pair in {b"op": b"\x03", **numbers, b"chunk_count": bytes(4)}.items()
        )
        return b"#ROSBAG V2.0\n" + words(fields) + words(b" " * 16)

    infos = b""
    with path.open("wb") as file:
        file.write(opened(0))
        for start in range(0, 4_000_000, 10_000):
            k = np.arange(start, start + 10_000)
            stamps = 10**18 + 10_000_000 * k
            times = np.stack([stamps // 10**9, stamps % 10**9], axis=-1).astype("<u4")
            rows = np.concatenate(
                [np.tile(before, (len(k), 1)), change(np.tile(one, (len(k), 1)), k)], axis=1
            )
            rows[:, time_at : time_at + 8] = times.view(np.uint8)
            content = connection + rows.tobytes()
            offsets = len(connection) + rows.shape[1] * np.arange(len(k), dtype="<u4")
            place, count = file.tell(), struct.pack("<I", len(k))
            size = struct.pack("<I", len(content))
            file.write(words(field(b"op", b"\x05") + field(b"compression", b"none") + field(b"size", size)))
            file.write(words(content))
            about = {b"op": b"\x04", b"ver": struct.pack("<I", 1), b"conn": bytes(4), b"count": count}
            file.write(words(b"".join(field(*pair) for pair in about.items())))
            file.write(words(np.column_stack([times, offsets]).astype("<u4").tobytes()))
            about = {
                b"op": b"\x06",
                b"ver": struct.pack("<I", 1),
                b"chunk_pos": struct.pack("<Q", place),
                b"start_time": times[0].tobytes(),
                b"end_time": times[-1].tobytes(),
                b"count": struct.pack("<I", 1),
            }
            infos += words(b"".join(field(*pair) for pair in about.items())) + words(bytes(4) + count)
        end = file.tell()
        file.write(connection + infos)
        file.seek(0)
        file.write(opened(end))


@pytest.mark.verify
@pytest.mark.parametrize(
    ("name", "write", "described"),
    [
        pytest.param("run.csv", write_rows, ROBOT.partition("log:")[0], id="L15-text"),
        pytest.param("run.jsonl", write_objects, ROBOT.partition("log:")[0], id="L15-json"),
        pytest.param("run.parquet", write_parquet, ROBOT.partition("log:")[0], id="L15-parquet"),
        pytest.param("run.mcap", write_joints, ROBOT, id="L15-mcap"),
        pytest.param("run.mcap", write_loose, ROBOT, id="L15-mcap-without-chunks"),
        pytest.param("run", write_database, ROBOT, id="L15-sqlite3"),
        pytest.param("run.bag", write_rosbag1, ROBOT, id="L15-rosbag1"),
    ],
)
def test_fault(name, write, described, tmp_path):
    """What a long log takes does not grow with it: four million rows, whose poses alone would be 0.6 GB."""
    robot, log = tmp_path / "robot.yaml", tmp_path / name
    robot.write_text(described)
    write(log)
    code, seconds, peak, said = measured("track", log, "--robot", robot, "-o", tmp_path / "out.tum")
    size = sum(file.stat().st_size for file in (log.iterdir() if log.is_dir() else [log]))
    print(f"{size / 1e6:.0f} MB of {name}: {seconds:.1f} s, {peak:.0f} MiB at most")
    assert code == 0, said
    assert peak < MOST_MEMORY
    with (tmp_path / "out.tum").open() as file:
        assert sum(1 for _ in file) >= 4_000_000
