"""Trajectories as MCAP: what rosbags reads of them, and that every byte of the file is accounted for."""

from __future__ import annotations

import contextlib
import math

import numpy as np
import pytest

import trundle as tr
from trundle.adapters import mcap_trajectory
from trundle.adapters.bag import open_bag
from trundle.adapters.mcap_trajectory import UNKNOWN
from trundle.adapters.trajectory import read_trajectory, write_trajectory
from trundle.errors import InputError, LogError, LogSchema, TrundleError

DIFF = tr.Differential(track_width=0.4, wheel_radius=0.05)
PLANAR = np.ix_((0, 1, 5), (0, 1, 5))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return tmp_path_factory.mktemp("mcap")


def driven(count: int = 200) -> tr.Trajectory:
    """A drive with covariances of odometry, without jolts: what is doubted for a moment, no twist says."""
    noise = tr.Noise(wheel_distance=0.01, lateral_slip=0.005)
    angles = np.cumsum(0.35 + 0.2 * np.sin(np.arange(count)[:, None] / 30.0 + np.arange(2)), axis=0)
    log = tr.WheelLog(
        time_ns=1_700_000_000_123_456_789 + np.arange(count) * 20_000_001,
        wheel_names=("left", "right"),
        wheels=angles,
    )
    return tr.integrate(tr.Robot(drive=DIFF, noise=noise), log)


def bare(count: int = 30) -> tr.Trajectory:
    poses = np.random.default_rng(4).normal(size=(count, 3))
    return tr.Trajectory(time_ns=np.arange(count) * 10_000_000, poses=poses, frame="mäp")


def messages_of(path):
    """Everything that rosbags reads, by topic; in a folder with no metadata it looks at the file itself."""
    reader = pytest.importorskip("rosbags.rosbag2.storage_mcap").McapReader(path)
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    reader.open()
    try:
        found: dict[str, list] = {}
        for connection in reader.connections:
            store = get_typestore(Stores.EMPTY)
            store.register(get_types_from_msg(connection.msgdef.data, connection.msgtype))
            rows = [
                (stamp, store.deserialize_cdr(raw, connection.msgtype))
                for _, stamp, raw in reader.messages([connection], None, None)
            ]
            found[connection.topic] = rows
        return found, {c.topic: c.msgcount for c in reader.connections}
    finally:
        reader.close()


def test_rosbags_reads_odometry(folder, monkeypatch):
    """Poses in `odom`, twists in `base_link`, covariances along the right axes and 1e6 elsewhere."""
    monkeypatch.setattr(mcap_trajectory, "CHUNK", 40_000)  # several chunks
    trajectory = driven()
    write_trajectory(trajectory, folder / "odom.mcap")
    found, counts = messages_of(folder / "odom.mcap")
    assert counts == {"/odom": 200, "/pose_in_frame": 200}
    assert [stamp for stamp, _ in found["/odom"]] == trajectory.time_ns.tolist()
    for k, (_, odometry) in enumerate(found["/odom"]):
        assert odometry.header.stamp.sec * 10**9 + odometry.header.stamp.nanosec == trajectory.time_ns[k]
        assert (odometry.header.frame_id, odometry.child_frame_id) == ("odom", "base_link")
        pose, twist = odometry.pose.pose, odometry.twist.twist
        assert [pose.position.x, pose.position.y, pose.position.z] == [*trajectory.poses[k, :2], 0.0]
        heading = 2.0 * math.atan2(pose.orientation.z, pose.orientation.w)
        assert math.remainder(heading - trajectory.poses[k, 2], math.tau) == pytest.approx(0.0, abs=1e-14)
        assert [twist.linear.x, twist.linear.y, twist.angular.z] == trajectory.twists[k].tolist()
        for covariance in (odometry.pose.covariance, odometry.twist.covariance):
            matrix = covariance.reshape(6, 6)
            assert (matrix == matrix.T).all() or np.allclose(matrix, matrix.T, rtol=1e-12)
            assert matrix[2, 2] == matrix[3, 3] == matrix[4, 4] == UNKNOWN
            assert np.linalg.eigvalsh(matrix).min() > -1e-12
        c, s = np.cos(trajectory.poses[k, 2]), np.sin(trajectory.poses[k, 2])
        turn = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
        np.testing.assert_allclose(
            odometry.pose.covariance.reshape(6, 6)[PLANAR],
            turn @ trajectory.covariances[k] @ turn.T,
            atol=1e-15,
        )
    for k, (_, posed) in enumerate(found["/pose_in_frame"]):
        assert posed.frame_id == "odom"
        assert posed.timestamp.sec * 10**9 + posed.timestamp.nanosec == trajectory.time_ns[k]
        assert posed.pose.position.x == trajectory.poses[k, 0]


def test_covariances_of_twists_add_up_to_those_of_poses(folder):
    """Who integrates the twists with their covariances gets the covariance of the last pose."""
    from trundle.geometry import se2

    trajectory = driven()
    write_trajectory(trajectory, folder / "twist.mcap", force=True)
    found, _ = messages_of(folder / "twist.mcap")
    sum_ = trajectory.covariances[0].copy()
    for k in range(1, len(trajectory)):
        dt = (trajectory.time_ns[k] - trajectory.time_ns[k - 1]) * 1e-9
        step = se2.compose(se2.inverse(trajectory.poses[k - 1]), trajectory.poses[k])
        moved = se2.adjoint(se2.inverse(step))
        added = found["/odom"][k][1].twist.covariance.reshape(6, 6)[PLANAR] * dt * dt
        sum_ = moved @ sum_ @ moved.T + added
    np.testing.assert_allclose(sum_, trajectory.covariances[-1], rtol=1e-3, atol=1e-8)


def test_poses_alone(folder):
    """No twists: a pose message, in which nothing is claimed to be known."""
    write_trajectory(bare(), folder / "pose.mcap")
    found, counts = messages_of(folder / "pose.mcap")
    assert counts == {"/pose": 30, "/pose_in_frame": 30}
    message = found["/pose"][7][1]
    assert message.header.frame_id == "mäp"
    assert np.diag(message.pose.covariance.reshape(6, 6)).tolist() == [UNKNOWN] * 6


@pytest.mark.parametrize("trajectory", [driven(), bare(), driven(1)], ids=["full", "poses", "one"])
def test_it_reads_back(folder, trajectory):
    path = folder / "back.mcap"
    write_trajectory(trajectory, path, force=True)
    back = read_trajectory(path)
    np.testing.assert_array_equal(back.time_ns, trajectory.time_ns)
    np.testing.assert_array_equal(back.poses[:, :2], trajectory.poses[:, :2])
    turned = np.exp(1j * back.poses[:, 2]) - np.exp(1j * trajectory.poses[:, 2])
    assert np.abs(turned).max() < 1e-14
    assert back.frame == trajectory.frame
    assert (back.twists is None) == (trajectory.twists is None)
    if trajectory.twists is None:
        assert back.covariances is None
    else:
        np.testing.assert_array_equal(back.twists, trajectory.twists)
        np.testing.assert_allclose(back.covariances, trajectory.covariances, atol=1e-15)


def test_nothing_is_left_unverified(folder):
    """Our own reader checks every checksum, count and index, and has nothing to remark."""
    write_trajectory(driven(), folder / "checked.mcap", force=True)
    with open_bag(folder / "checked.mcap") as bag:
        assert bag.warnings == []
        assert bag.losses == []
        assert {topic: info.count for topic, info in bag.topics.items()} == {
            "/odom": 200,
            "/pose_in_frame": 200,
        }


def test_an_empty_trajectory_is_a_file(folder):
    nothing = tr.Trajectory(time_ns=np.empty(0, np.int64), poses=np.empty((0, 3)))
    write_trajectory(nothing, folder / "empty.mcap")
    assert messages_of(folder / "empty.mcap") == (
        {"/pose": [], "/pose_in_frame": []},
        {"/pose": 0, "/pose_in_frame": 0},
    )


def test_flipped_bits_and_cuts_are_noticed(folder):
    """Every byte but the library's name in the header is under a checksum or compared with another."""
    write_trajectory(driven(40), folder / "whole.mcap", force=True)
    whole = bytearray((folder / "whole.mcap").read_bytes())
    expected = read_trajectory(folder / "whole.mcap").poses
    path, rng = folder / "broken.mcap", np.random.default_rng(1)
    for _ in range(300):
        bit = int(rng.integers(8 * len(whole)))
        whole[bit // 8] ^= 1 << bit % 8
        path.write_bytes(whole)
        with contextlib.suppress(TrundleError):
            np.testing.assert_array_equal(read_trajectory(path).poses, expected)
        whole[bit // 8] ^= 1 << bit % 8
    for size in rng.integers(0, len(whole), 100).tolist():
        path.write_bytes(whole[:size])
        try:
            np.testing.assert_array_equal(read_trajectory(path).poses, expected)
        except LogError:
            continue
        with open_bag(path) as bag:
            assert any("unverified" in warning for warning in bag.warnings)


@pytest.mark.parametrize("stamp", [-1, 2**31 * 10**9, 2**63 - 1])
def test_stamps_that_ros_cannot_say(folder, stamp):
    trajectory = tr.Trajectory(time_ns=np.array([stamp]), poses=np.zeros((1, 3)))
    with pytest.raises(InputError, match="between 1970 and 2038"):
        write_trajectory(trajectory, folder / "late.mcap")


def test_a_heading_that_is_not_known_cannot_be_said(folder):
    trajectory = tr.Trajectory(time_ns=np.array([1]), poses=np.array([[1.0, 2.0, np.nan]]))
    with pytest.raises(InputError, match=r"pose 0 .* must be finite in a \.mcap file"):
        write_trajectory(trajectory, folder / "nan.mcap")


def test_recordings_of_others(shared_data):
    """The one topic of odometry that a recording holds."""
    path = shared_data / "turtlebot_nav2" / "nav2_turtlebot.mcap"
    if not path.exists():
        pytest.skip(f"{path} is not on this machine")
    trajectory = read_trajectory(path)
    assert trajectory.duration == pytest.approx(97.0, abs=3.0)
    assert trajectory.distance > 5.0


def test_which_of_several_is_not_guessed(folder):
    names = [mcap_trajectory.Channel(name, "nav_msgs/msg/Odometry", "float64 x\n") for name in ("/a", "/b")]
    with (folder / "two.mcap").open("wb") as file, mcap_trajectory.McapWriter(file, names) as writer:
        assert writer
    with pytest.raises(LogSchema, match="/a, /b are all nav_msgs/msg/Odometry; a trajectory is one"):
        read_trajectory(folder / "two.mcap")
