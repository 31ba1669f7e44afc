"""Pictures: that they show what they should; whether they are good to look at is for eyes."""

from __future__ import annotations

import dataclasses
import math
import sys
import warnings

import numpy as np
import pytest

from trundle.errors import InputError, MissingExtra, OutputError
from trundle.geometry import Pose2D, se2
from trundle.records import Reading, Trajectory, WheelLog
from trundle.robot import Differential, Encoder, Robot

pytest.importorskip("matplotlib", reason="matplotlib is not installed")

from trundle.apps.calibration_plot import plot_paths
from trundle.apps.calibration_report import report_page
from trundle.apps.plot import plot_trajectory, save_plot
from trundle.calibrate.calibration import Calibration, RunFit
from trundle.evaluate import transform

SECOND = 1_000_000_000
STAMPS = 1_700_000_000 * SECOND + np.arange(101) * (SECOND // 10)
TIME = (STAMPS - STAMPS[0]) * 1e-9
SPEEDS = np.array([3.0, 5.0])  # rad/s, left and right


def arc(**columns):
    poses = se2.exp(np.column_stack([0.5 * TIME, 0 * TIME, 0.3 * TIME]))
    return Trajectory(time_ns=STAMPS, poses=poses, **columns)


def lines(axis):
    """Drawn curves by their name in the legend."""
    return {line.get_label(): line.get_xydata() for line in axis.get_lines()}


def texts(figure):
    return " ".join(t.get_text() for axis in figure.axes for t in (axis.title, axis._left_title, *axis.texts))


def test_the_map_shows_path_start_end_and_its_size():
    trajectory = arc(frame="world")
    figure = plot_trajectory(trajectory, title="A drive")
    (axis,) = figure.axes
    drawn = lines(axis)
    np.testing.assert_array_equal(drawn["odometry"], trajectory.poses[:, :2])
    np.testing.assert_array_equal(drawn["start"], trajectory.poses[:1, :2])
    np.testing.assert_array_equal(drawn["end"], trajectory.poses[-1:, :2])
    assert axis.get_xlabel() == "x in world [m]"
    assert axis.get_aspect() == 1.0
    assert "A drive" in texts(figure)
    assert f"10.0 s  ·  {trajectory.distance:.2f} m driven" in texts(figure)


def test_names_are_not_formulas(tmp_path):
    name = r"$\frac{left$"
    log = WheelLog(time_ns=STAMPS, wheel_names=(name,), wheels=TIME[:, None])
    save_plot(plot_trajectory(arc(frame=name), log=log, title=name), tmp_path / "odd.svg")


@pytest.mark.parametrize("suffix", [".png", ".svg", ".pdf"])
def test_letters_that_a_font_lacks_are_no_warning(tmp_path, suffix):
    """Robots are named in all languages, and Python's warnings are not for users."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        save_plot(plot_trajectory(arc(), title="小车 \N{ROBOT FACE}"), tmp_path / f"robot{suffix}")
    assert (tmp_path / f"robot{suffix}").stat().st_size > 1000


def test_arrows_point_along_the_heading():
    from matplotlib.quiver import Quiver

    (arrows,) = (c for c in plot_trajectory(arc()).axes[0].collections if isinstance(c, Quiver))
    assert 6 <= len(arrows.U) <= 40
    found = {(round(float(x), 9), round(float(y), 9)) for x, y in arrows.get_offsets()}
    assert found <= {(round(float(x), 9), round(float(y), 9)) for x, y in arc().poses[:, :2]}
    # On this circle about (0, radius) the heading is the direction from its centre, plus 90 degrees.
    x, y = np.asarray(arrows.get_offsets()).T
    radius = 0.5 / 0.3
    np.testing.assert_allclose(
        np.arctan2(arrows.V, arrows.U), np.arctan2(x / radius, 1 - y / radius), atol=1e-9
    )


def test_ellipses_do_not_hide_the_path():
    """Of a doubt as wide as the whole path one ellipse tells; of a growing one those that are told apart."""
    for variances, most in ((np.full(101, 25.0), 1), (np.linspace(0.01, 100.0, 101) ** 2, 5)):
        covariances = variances[:, None, None] * np.eye(3)
        figure = plot_trajectory(arc(covariances=covariances))
        (outlines,) = (c for c in figure.axes[0].collections if c.get_label() == "95 % uncertainty")
        sizes = [np.ptp(path.vertices[:, 0]) for path in outlines.get_paths()]
        assert 1 <= len(sizes) <= most
        assert sizes[-1] == pytest.approx(2.0 * np.sqrt(5.991 * variances[-1]), rel=1e-2)  # the last is there
    small = plot_trajectory(arc(covariances=np.broadcast_to(1e-6 * np.eye(3), (101, 3, 3))))
    (outlines,) = (c for c in small.axes[0].collections if c.get_label() == "95 % uncertainty")
    assert len(outlines.get_paths()) == 8


def test_a_reference_that_jumps_is_not_joined_across():
    truth = arc()
    poses = truth.poses.copy()
    poses[60:] += [30.0, -20.0, 0.0]
    figure = plot_trajectory(arc(), reference=dataclasses.replace(truth, poses=poses))
    drawn = lines(figure.axes[0])["reference, aligned"]
    assert len(drawn) == 102
    assert np.flatnonzero(np.isnan(drawn).any(axis=1)).tolist() == [60]


def test_a_long_drive_is_not_told_in_thousands_of_seconds():
    long = dataclasses.replace(arc(), time_ns=STAMPS[0] + np.arange(101) * 35 * SECOND)
    assert "58 min 20 s  ·" in texts(plot_trajectory(long))


def test_ellipses_hold_95_percent_in_the_odom_frame():
    covariance = np.array([[0.04, 0.01, 0.003], [0.01, 0.02, 0.0], [0.003, 0.0, 0.01]])
    trajectory = arc(covariances=np.broadcast_to(covariance, (101, 3, 3)))
    figure = plot_trajectory(trajectory)
    (outlines,) = (c for c in figure.axes[0].collections if c.get_label() == "95 % uncertainty")
    outline = outlines.get_paths()[-1].vertices
    x, y, theta = trajectory.poses[-1]
    c, s = math.cos(theta), math.sin(theta)
    rotation = np.array([[c, -s], [s, c]])
    inverse = np.linalg.inv(rotation @ covariance[:2, :2] @ rotation.T)
    offset = outline - [x, y]
    # Chi-square with two degrees of freedom is an exponential distribution: its 95 % point is -2 ln 0.05.
    np.testing.assert_allclose(
        np.einsum("ni,ij,nj->n", offset, inverse, offset), -2.0 * math.log(0.05), rtol=1e-3
    )


def test_the_reference_is_brought_into_the_frame_of_the_trajectory():
    trajectory = arc()
    moved = transform(trajectory, Pose2D(10.0, -4.0, 2.0), frame="map")
    figure = plot_trajectory(trajectory, reference=moved)
    np.testing.assert_allclose(
        lines(figure.axes[0])["reference, aligned"], trajectory.poses[:, :2], atol=1e-12
    )
    assert "m RMSE from the reference" in texts(figure)


def test_a_reference_that_cannot_be_aligned_is_not_drawn_and_the_picture_says_why():
    late = Trajectory(time_ns=STAMPS + 3600 * SECOND, poses=arc().poses)
    figure = plot_trajectory(arc(), reference=late)
    assert "reference, aligned" not in lines(figure.axes[0])
    assert "reference not drawn: estimate and reference have no time in common" in texts(figure).replace(
        "\n", " "
    )


def robot():
    drive = Differential(track_width=0.2, wheel_radius=0.042)
    encoders = {
        "left": Encoder(ticks_per_revolution=4000.0, bits=12),
        "right": Encoder(ticks_per_revolution=1000.0, inverted=True),
    }
    return Robot(drive=drive, encoders=encoders)


def wheel_log(reading):
    angle = SPEEDS * TIME[:, None]
    if reading is Reading.POSITION:
        wheels = angle
    elif reading is Reading.INCREMENT:
        wheels = np.diff(angle, axis=0, prepend=0.0)
    elif reading is Reading.VELOCITY:
        wheels = np.broadcast_to(SPEEDS, angle.shape)
    else:
        ticks = np.round(angle / math.tau * [4000.0, -1000.0]).astype(np.int64)
        wheels = np.column_stack([ticks[:, 0] % 4096, ticks[:, 1]])
    return WheelLog(time_ns=STAMPS, wheel_names=("left", "right"), wheels=wheels, reading=reading)


@pytest.mark.parametrize("reading", Reading)
def test_wheel_speeds_are_in_radians_per_second_whatever_the_log_says(reading):
    figure = plot_trajectory(arc(), log=wheel_log(reading), robot=robot())
    axis = figure.axes[1]
    assert axis.get_ylabel() == "wheel speed [rad/s]"
    tick = math.tau / 1000.0 / 0.1 if reading is Reading.TICKS else 1e-9
    for name, speed in zip(("left", "right"), SPEEDS, strict=True):
        curve = lines(axis)[name]
        np.testing.assert_allclose(curve[:, 0], TIME[1:], atol=1e-9)
        np.testing.assert_allclose(curve[:, 1], speed, atol=tick)


def test_ticks_stay_ticks_without_a_robot():
    figure = plot_trajectory(arc(), log=wheel_log(Reading.TICKS))
    assert figure.axes[1].get_ylabel() == "wheel speed [ticks/s]"
    right = lines(figure.axes[1])["right"][:, 1]
    assert right.mean() == pytest.approx(-5.0 / math.tau * 1000.0, rel=0.01)


def test_steering_and_body_speeds_have_their_own_axes():
    log = WheelLog(
        time_ns=STAMPS, twists=np.column_stack([0.5 + 0 * TIME, 0 * TIME, 0.3 + 0 * TIME]),
        steering_names=("front",), steering=np.sin(TIME)[:, None],
    )  # fmt: skip
    _, speeds, steering = plot_trajectory(arc(), log=log).axes
    assert speeds.get_ylabel() == "body speed"
    assert set(lines(speeds)) == {"forward [m/s]", "left [m/s]", "yaw rate [rad/s]"}
    assert steering.get_ylabel() == "steering [rad]"
    np.testing.assert_allclose(lines(steering)["front"][:, 1], np.sin(TIME))


def test_hostile_rows_neither_stretch_the_axes_nor_draw_lines_back():
    wheels = np.array(np.broadcast_to(SPEEDS, (101, 2)))
    wheels += 0.1 * np.sin(TIME)[:, None]
    wheels[10], wheels[20, 0], wheels[30, 1] = math.nan, 1e6, -1e6
    stamps = STAMPS.copy()
    stamps[40], stamps[50], stamps[60] = 0, STAMPS[50] + 10**18, STAMPS[55]
    log = WheelLog(time_ns=stamps, wheel_names=("left", "right"), wheels=wheels, reading=Reading.VELOCITY)
    figure = plot_trajectory(arc(), log=log)
    axis = figure.axes[1]
    for name in ("left", "right"):
        time = lines(axis)[name][:, 0]
        assert (np.diff(time) > 0.0).all()
        assert time[-1] == pytest.approx(10.0)
        assert len(time) == 96
    assert max(np.abs(axis.get_ylim())) < 50.0
    assert "2 samples beyond, -1e+06 to 1e+06" in texts(figure)


def test_thousands_of_samples_are_drawn_as_their_mean_and_range():
    count = 20_000
    rng = np.random.default_rng(0)
    stamps = STAMPS[0] + np.arange(count) * (SECOND // 100)
    wheels = rng.normal(2.0, 0.1, (count, 1))
    log = WheelLog(time_ns=stamps, wheel_names=("one",), wheels=wheels, reading=Reading.VELOCITY)
    poses = se2.exp(np.column_stack([np.linspace(0, 20, count), np.zeros(count), np.linspace(0, 3, count)]))
    figure = plot_trajectory(Trajectory(time_ns=stamps, poses=poses), log=log)
    (curve,) = lines(figure.axes[1]).values()
    assert len(curve) < 500
    np.testing.assert_allclose(curve[:, 1], 2.0, atol=0.1)
    (band,) = figure.axes[1].collections
    assert band.get_paths()[0].vertices[:, 1].max() == pytest.approx(wheels[1:].max())


@pytest.mark.parametrize("samples", [0, 1, 2])
def test_next_to_nothing_is_drawn_too(samples, tmp_path):
    trajectory = Trajectory(
        time_ns=STAMPS[:samples], poses=np.zeros((samples, 3)), covariances=np.zeros((samples, 3, 3))
    )
    log = WheelLog(time_ns=STAMPS[:samples], wheel_names=("a",), wheels=np.zeros((samples, 1)))
    reference = Trajectory(time_ns=STAMPS[:0], poses=np.zeros((0, 3)))
    path = tmp_path / "small.png"
    save_plot(plot_trajectory(trajectory, log=log, reference=reference), path)
    assert path.stat().st_size > 1000


@pytest.mark.parametrize(("suffix", "magic"), [(".png", b"\x89PNG"), (".svg", b"<?xml"), (".PDF", b"%PDF")])
def test_pictures_are_written_in_the_format_of_their_suffix(tmp_path, suffix, magic):
    path = tmp_path / f"picture{suffix}"
    path.write_bytes(b"old")
    save_plot(plot_trajectory(arc()), path)
    assert path.read_bytes().startswith(magic)
    assert list(tmp_path.iterdir()) == [path]


def test_pictures_that_cannot_be_written_leave_the_old_file(tmp_path, monkeypatch):
    figure = plot_trajectory(arc())
    with pytest.raises(InputError, match=r"\.png, \.svg, \.pdf"):
        save_plot(figure, tmp_path / "picture.jpeg")
    with pytest.raises(OutputError, match=r"nowhere"):
        save_plot(figure, tmp_path / "nowhere" / "picture.png")
    assert list(tmp_path.iterdir()) == []


def test_without_matplotlib_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "matplotlib.figure", None)
    with pytest.raises(MissingExtra, match=r"trundle\[plot\]"):
        plot_trajectory(arc())


def test_no_window_toolkit_and_no_pyplot_are_loaded():
    import subprocess

    code = (
        "import sys\nimport numpy as np\nfrom trundle.apps.plot import Trajectory, plot_trajectory\n"
        "assert 'matplotlib' not in sys.modules\n"
        "plot_trajectory(Trajectory(time_ns=np.arange(3), poses=np.zeros((3, 3))))\n"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_a_robot_that_turns_on_the_spot_is_a_dot():
    poses = np.column_stack([1e-4 * np.cos(9 * TIME), 1e-4 * np.sin(9 * TIME), TIME])
    axis = plot_trajectory(Trajectory(time_ns=STAMPS, poses=poses)).axes[0]
    for low, high in (axis.get_xlim(), axis.get_ylim()):
        assert high - low >= 0.19


def test_long_names_of_wheels_stay_beside_the_picture(tmp_path):
    names = tuple(f"wheel_{k}_of_the_rocker_bogie_at_the_front" for k in range(6))
    wheels = np.multiply.outer(TIME, np.arange(6.0))
    log = WheelLog(time_ns=STAMPS, wheel_names=names, wheels=wheels)
    figure = plot_trajectory(arc(), log=log)
    save_plot(figure, tmp_path / "a.png")  # a layout that fails warns
    box = figure.axes[1].get_legend().get_window_extent()
    assert box.x1 <= figure.bbox.x1
    assert box.y1 <= figure.axes[0].get_tightbbox().y0
    plain = plot_trajectory(arc(), reference=arc()).axes[0].get_legend()
    assert plain._ncols == 4


def run_fit(name, stamps, reference=None):
    path = Trajectory(time_ns=STAMPS[:stamps], poses=arc().poses[:stamps])
    return RunFit(name=name, before=path, after=path, reference=reference, residuals=np.zeros((stamps, 3)))


def test_of_a_tape_measure_both_ends_are_drawn_and_no_path():
    figure = plot_paths([run_fit("tape", 2), run_fit("camera", 101, arc())])
    tape, camera = (lines(axis) for axis in figure.axes)
    assert {"start", "end, before", "end, after"} <= tape.keys()
    assert {"reference", "before", "after"} <= camera.keys()
    (legend,) = figure.legends  # of all runs, not of the first one
    assert {text.get_text() for text in legend.get_texts()} == {
        "start", "end, before", "end, after", "reference", "before", "after",
    }  # fmt: skip


def test_a_report_draws_errors_only_where_a_reference_knows_places():
    found = Calibration(
        robot=robot(), estimates=(), covariance=np.zeros((0, 0)), chi2_per_dof=1.0, condition=1.0, samples=2,
        inliers=2, fits=(run_fit("tape", 2),),
    )  # fmt: skip
    page = report_page(found, None, title="rover")
    assert "Paths before and after" in page
    assert "How far off they were" not in page
    assert "What is left" not in page
    seen = dataclasses.replace(found, fits=(run_fit("tape", 2), run_fit("camera", 101, arc())))
    assert "How far off they were" in report_page(seen, None, title="rover")
