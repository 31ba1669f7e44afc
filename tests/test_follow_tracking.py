"""Followers close the loop: a simulated robot, its own odometry, and a course of ten metres."""

from __future__ import annotations

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest

from trundle import (
    Ackermann,
    ConfigError,
    Differential,
    Limits,
    Mecanum,
    Noise,
    PathError,
    Pose2D,
    Robot,
    Twist2D,
    WheelOdometry,
    wrap,
)
from trundle.command import Envelope
from trundle.follow import (
    CircularArc,
    HolonomicPid,
    Line,
    Path,
    Pid,
    PurePursuit,
    Ramsete,
    SpeedLimits,
    Status,
    Supervision,
    TimedPath,
    TrajectoryFollower,
    quintic_between,
    spline_through,
)
from trundle.simulate import NOISELESS, SimulatedRobot

PERIOD_NS = 10_000_000
COURSE = [
    Line((0.0, 0.0), (2.0, 0.0)),
    CircularArc(Pose2D(2.0, 0.0, 0.0), 1.0, math.pi / 2),
    quintic_between(Pose2D(3.0, 1.0, math.pi / 2), Pose2D(1.0, 4.0, math.pi)),
    Line((1.0, 4.0), (-1.5, 4.0)),
]
DIFFERENTIAL = Differential(track_width=0.5, wheel_radius=0.075)
MECANUM = Mecanum(track_width=0.4, wheelbase=0.4, wheel_radius=0.05)


class Run(NamedTuple):
    """The worst of a run: off the reference [m, rad] by odometry, odometry off the truth [m]; and its end."""

    error: float
    turned: float
    truth: float
    status: Status
    pose: Pose2D
    true_pose: Pose2D


def drive_along(robot, follower, *, noise=None, seed=0, lag=0.0, start=None, reference=None, limit=60.0):
    """Let a simulated robot follow, on nothing but its own odometry."""
    simulated = SimulatedRobot(robot, noise=noise, seed=seed, lag=lag, pose=start)
    odometry = WheelOdometry(robot, pose=start or Pose2D())
    reading = simulated.reading()
    state = odometry.update(time_ns=0, positions=reading.positions, steering=reading.steering)
    following = follower.start(0) if isinstance(follower, TrajectoryFollower) else follower.start()
    error = turned = truth = 0.0
    while True:
        guidance, following = follower.step(following, simulated.time_ns, state.pose, state.time_ns)
        wanted = state.pose if reference is None else reference(simulated.time_ns * 1e-9)
        error = max(error, guidance.deviation)
        turned = max(turned, abs(wrap(wanted.theta - state.pose.theta)))
        truth = max(truth, math.dist((state.pose.x, state.pose.y), (simulated.pose.x, simulated.pose.y)))
        if guidance.status.stops or simulated.time_ns > limit * 1e9:
            return Run(error, turned, truth, guidance.status, state.pose, simulated.pose)
        command = robot.drive.inverse(guidance.twist, simulated.steering or None)
        reading = simulated.step(command, PERIOD_NS * 1e-9)
        state = odometry.update(
            time_ns=reading.time_ns, positions=reading.positions, steering=reading.steering
        )


def trajectory_for(robot, facing=None, *, speed=0.4):
    limits = SpeedLimits(max_speed=speed, max_acceleration=0.5, max_jerk=2.0, load=Envelope(robot).load)
    return TimedPath.fastest(Path(COURSE, facing=facing), limits)


FOLLOWERS = {
    "differential, ramsete": (DIFFERENTIAL, Ramsete(b=300.0, zeta=0.95), None),
    "mecanum, holonomic": (
        MECANUM,
        HolonomicPid(forward=Pid(kp=10.0), leftward=Pid(kp=10.0), heading=Pid(kp=10.0)),
        (0.0, 3.0),
    ),
}


@pytest.mark.parametrize("name", FOLLOWERS)
@pytest.mark.parametrize("seed", [0, 1, 2])
def test_two_centimetres_and_two_degrees_on_ten_metres(name, seed, record_property):
    """With 2 % of wheel noise (0.02 m per sqrt(m)) and motors that lag by 10 ms."""
    drive, controller, facing = FOLLOWERS[name]
    robot = Robot(drive=drive, noise=Noise(wheel_distance=0.02), limits=Limits(max_wheel_speed=25.0))
    trajectory = trajectory_for(robot, facing)
    assert trajectory.path.length > 10.0
    follower = TrajectoryFollower(trajectory, controller)
    run = drive_along(robot, follower, seed=seed, lag=0.01, reference=lambda time: trajectory.at(time).pose)
    record_property("distance from the truth [m]", run.truth)
    assert run.status is Status.ARRIVED
    assert run.error < 0.02
    assert math.degrees(run.turned) < 2.0
    # Odometry does not know what its wheels do not tell: that is not the follower's error.
    assert run.truth > run.error


@pytest.mark.parametrize(
    ("drive", "controller", "facing"),
    [
        (DIFFERENTIAL, Ramsete(), None),
        (Ackermann(wheelbase=0.4, track_width=0.3, wheel_radius=0.05), Ramsete(), None),
        (MECANUM, HolonomicPid(), (0.0, 3.0)),
        (MECANUM, HolonomicPid(), None),
    ],
)
def test_tracking_without_noise_is_that_of_the_period(drive, controller, facing):
    """What is left is that wheels hold still for 10 ms."""
    robot = Robot(drive=drive, noise=NOISELESS)
    trajectory = trajectory_for(robot, facing, speed=1.0)
    run = drive_along(
        robot, TrajectoryFollower(trajectory, controller), reference=lambda time: trajectory.at(time).pose
    )
    assert run.status is Status.ARRIVED
    assert run.error < 0.005
    assert math.degrees(run.turned) < 1.0
    assert run.truth < 1e-3


def test_radii_that_are_two_percent_wrong_mislead_odometry_alone():
    """The follower keeps to what odometry says; where the robot really is, is reported beside it."""
    believed = Robot(drive=DIFFERENTIAL, noise=NOISELESS)
    real = Differential(track_width=0.5, wheel_radius={"left": 0.075, "right": 0.0765})
    trajectory = trajectory_for(believed)
    follower = TrajectoryFollower(trajectory, Ramsete(b=30.0))
    simulated, odometry = SimulatedRobot(real, noise=NOISELESS), WheelOdometry(believed)
    state, following = odometry.update(time_ns=0, positions=(0.0, 0.0)), follower.start(0)
    worst = 0.0
    while True:
        guidance, following = follower.step(following, simulated.time_ns, state.pose, state.time_ns)
        worst = max(worst, guidance.deviation)
        if guidance.status.stops:
            break
        reading = simulated.step(DIFFERENTIAL.inverse(guidance.twist), 0.01)
        state = odometry.update(time_ns=reading.time_ns, positions=reading.positions)
    assert guidance.status is Status.ARRIVED
    assert worst < 0.01
    assert math.dist((simulated.pose.x, simulated.pose.y), (state.pose.x, state.pose.y)) > 0.5


@pytest.mark.parametrize("drive", [DIFFERENTIAL, MECANUM])
@pytest.mark.parametrize("offset", [(0.1, 0.1, 0.3), (-0.1, -0.15, -0.4), (0.0, 0.2, 0.0)])
def test_a_robot_that_starts_beside_the_path_comes_onto_it(drive, offset):
    controller = Ramsete(b=8.0) if drive is DIFFERENTIAL else HolonomicPid()
    trajectory = trajectory_for(Robot(drive=drive))
    follower = TrajectoryFollower(trajectory, controller)
    state, pose, now = follower.start(0), Pose2D(*offset), 0
    while True:
        guidance, state = follower.step(state, now, pose, now)
        if guidance.status.stops:
            break
        pose = pose @ Pose2D.exp(guidance.twist * 0.01)
        now += PERIOD_NS
    assert guidance.status is Status.ARRIVED
    assert guidance.deviation < 0.01


def test_holonomic_velocity_is_turned_by_the_error_of_the_heading():
    """No gains: what is left is the reference's own velocity in the field, whatever way the robot looks."""
    nothing = HolonomicPid(forward=Pid(kp=0.0), leftward=Pid(kp=0.0), heading=Pid(kp=0.0))
    reference = trajectory_for(Robot(drive=MECANUM), (0.0, 3.0)).at(5.0)
    for heading in (0.0, 1.0, -2.5):
        twist, _ = nothing.step(nothing.start(), reference, Pose2D(9.0, 9.0, heading), 0.01)
        c, s = math.cos(heading), math.sin(heading)
        field = (c * twist.vx - s * twist.vy, s * twist.vx + c * twist.vy)
        assert field == pytest.approx((reference.field_velocity.vx, reference.field_velocity.vy))


def test_ramsete_is_lyapunov_stable():
    """De Luca's function V = b/2 (ex^2 + ey^2) + etheta^2/2 never grows, for any reference velocity."""
    controller = Ramsete(b=2.0, zeta=0.7)
    straight = Path([CircularArc(Pose2D(), 2.0, 3.0)])
    trajectory = TimedPath.fastest(straight, SpeedLimits(max_speed=1.0, max_acceleration=1.0))

    def energy(time, pose):
        error = pose.inverse() @ trajectory.at(time).pose
        return 0.5 * controller.b * (error.x**2 + error.y**2) + 0.5 * wrap(error.theta) ** 2

    chance = np.random.default_rng(2)
    for x, y, theta in chance.uniform(-1.0, 1.0, (200, 3)).tolist():
        time = 3.0
        pose = trajectory.at(time).pose @ Pose2D(x, y, 2.0 * theta)
        twist = controller.command(trajectory.at(time), pose)
        later = pose @ Pose2D.exp(twist * 1e-6)
        assert energy(time + 1e-6, later) <= energy(time, pose) + 1e-11


def test_pid_does_not_wind_up_and_sees_the_rate():
    pid = Pid(kp=2.0, ki=1.0, kd=0.5, max_integral=0.3)
    integral = 0.0
    for _ in range(100):
        integral = pid.integrate(integral, 1.0, 0.1)
    assert integral == 0.3
    assert pid.output(integral, 1.0, -2.0) == pytest.approx(2.0 + 0.3 - 1.0)
    with pytest.raises(ConfigError, match="kp"):
        Pid(kp=-1.0)


def test_integral_takes_out_a_constant_push():
    controller = HolonomicPid(leftward=Pid(kp=4.0, ki=4.0, max_integral=1.0))
    trajectory = TimedPath.fastest(
        Path([Line((0.0, 0.0), (8.0, 0.0))]), SpeedLimits(max_speed=1.0, max_acceleration=1.0)
    )
    follower = TrajectoryFollower(trajectory, controller)
    state, pose, now = follower.start(0), Pose2D(), 0
    while True:
        guidance, state = follower.step(state, now, pose, now)
        if guidance.status.stops:
            break
        pushed = Twist2D(guidance.twist.vx, guidance.twist.vy - 0.1, guidance.twist.omega)
        pose, now = pose @ Pose2D.exp(pushed * 0.01), now + PERIOD_NS
    assert abs(pose.y) < 2e-3


# ------------------------------------------------------------------- pure pursuit


def pursue(pursuit, pose, *, steps=6000, period=0.02):
    state, now = pursuit.start(), 0
    worst, trail = 0.0, []
    for _ in range(steps):
        guidance, state = pursuit.step(state, now, pose, now)
        if guidance.status.stops:
            return guidance, pose, worst, trail
        worst = max(worst, guidance.deviation)
        trail.append((pose, guidance.twist, state))
        pose, now = pose @ Pose2D.exp(guidance.twist * period), now + round(period * 1e9)
    return guidance, pose, worst, trail


def test_pursuit_is_coulters_arc():
    pursuit = PurePursuit(Path([Line((0.0, 0.0), (9.0, 0.0))]), speed=1.0, lookahead=0.5)
    state = pursuit.start(Pose2D(1.0, 0.2, 0.0))
    guidance, _ = pursuit.step(state, 0, Pose2D(1.0, 0.2, 0.0), 0)
    assert guidance.twist.curvature == pytest.approx(2.0 * -0.2 / (0.5**2 + 0.2**2))
    assert guidance.twist.vx == 1.0


def test_pursuit_follows_the_course():
    guidance, pose, worst, _ = pursue(PurePursuit(Path(COURSE), speed=1.0, lookahead=0.3), Pose2D())
    assert guidance.status is Status.ARRIVED
    assert worst < 0.03
    assert math.dist((pose.x, pose.y), (-1.5, 4.0)) < 0.015


@pytest.mark.parametrize("start", [Pose2D(0.0, 0.3, 0.5), Pose2D(-0.3, -0.3, -1.0)])
def test_pursuit_comes_onto_the_path(start):
    guidance, pose, *_ = pursue(PurePursuit(Path(COURSE), speed=0.6), start)
    assert guidance.status is Status.ARRIVED
    assert math.dist((pose.x, pose.y), (-1.5, 4.0)) < 0.02


def test_pursuit_on_a_path_that_crosses_itself():
    """K13: at the crossing of a figure eight it goes on along its own branch."""
    t = np.linspace(0.0, math.tau, 400)
    eight = Path([spline_through(np.stack([2.0 * np.sin(t), 2.0 * np.sin(t) * np.cos(t)], axis=1))])
    start = eight.at(0.0).pose
    guidance, _, worst, trail = pursue(PurePursuit(eight, speed=0.8, lookahead=0.25), start)
    assert guidance.status is Status.ARRIVED
    assert worst < 0.03
    distances = [state.distance for *_, state in trail]
    assert max(abs(b - a) for a, b in pairwise(distances)) < 0.05
    assert distances[-1] > eight.length - 0.1


def test_pursuit_of_a_car_never_turns_tighter_than_it_can():
    path = Path([Line((0.0, 0.0), (4.0, 0.0)), CircularArc(Pose2D(4.0, 0.0, 0.0), 1.0, math.pi)])
    pursuit = PurePursuit(path, speed=0.8, max_curvature=1.5, supervision=Supervision(max_deviation=3.0))
    guidance, _, _, trail = pursue(pursuit, Pose2D(0.0, 0.0, 3.0))  # it looks away from the path
    assert guidance.status is Status.ARRIVED
    assert max(abs(twist.curvature) for _, twist, _ in trail) <= 1.5 + 1e-9


def test_pursuit_slows_down_where_it_must():
    path = Path(COURSE)
    pursuit = PurePursuit(
        path,
        speed=1.0,
        max_lateral_acceleration=0.5,
        feasible_speed=lambda pose, curvature: 0.9 / (1.0 + abs(curvature)),
    )
    *_, trail = pursue(pursuit, Pose2D())
    for _, twist, _ in trail:
        if twist.vx:
            assert twist.vx**2 * abs(twist.curvature) <= 0.5 + 1e-9
            assert twist.vx <= 0.9 / (1.0 + abs(twist.curvature)) + 1e-9
    assert trail[-1][1].vx < 0.15  # at the end it is slow


@pytest.mark.parametrize("feasible", [math.nan, 0.0, -1.0])
def test_pursuit_stands_still_where_nothing_is_feasible(feasible):
    pursuit = PurePursuit(Path(COURSE), speed=1.0, feasible_speed=lambda pose, curvature: feasible)
    guidance, _ = pursuit.step(pursuit.start(), 0, Pose2D(), 0)
    assert guidance.twist.vx == guidance.twist.omega == 0.0


# ------------------------------------------------------------------------ faults


def loop(kind):
    if kind == "pursuit":
        return PurePursuit(Path(COURSE), speed=0.5)
    robot = Robot(drive=DIFFERENTIAL if kind == "ramsete" else MECANUM)
    return TrajectoryFollower(trajectory_for(robot), Ramsete() if kind == "ramsete" else HolonomicPid())


def begun(follower):
    return follower.start(0) if isinstance(follower, TrajectoryFollower) else follower.start()


def fault_far_away(kind):
    """K13: 50 m from the path is not a place to start from."""
    follower = loop(kind)
    guidance, state = follower.step(begun(follower), 0, Pose2D(50.0, 0.0, 1.0), 0)
    assert guidance.status is Status.OFF_PATH
    assert guidance.twist == Twist2D()
    assert guidance.deviation > 40.0
    guidance, _ = follower.step(state, PERIOD_NS, Pose2D(), PERIOD_NS)
    assert guidance.status is Status.OFF_PATH  # and it stays stopped


def fault_no_pose(kind):
    """K14: no pose, an old one, one that is not a number, one from another clock: stop, and stay stopped."""
    follower = loop(kind)
    fresh, state = follower.step(begun(follower), 0, Pose2D(), 0)
    assert fresh.status is Status.FOLLOWING
    timeout = round(follower.supervision.pose_timeout * 1e9)
    held, _ = follower.step(state, timeout, Pose2D(), 0)
    assert held.status is Status.FOLLOWING
    for pose, now, stamp in (
        (None, 1, 1),
        (Pose2D(), timeout + 1, 0),
        (Pose2D(math.nan), 1, 1),
        (Pose2D(0.0, 0.0, math.inf), 1, 1),
        (Pose2D(), 1, timeout + 2),
    ):
        guidance, ended = follower.step(state, now, pose, stamp)
        assert guidance.status is Status.NO_POSE
        assert guidance.twist == Twist2D()
        later, _ = follower.step(ended, now + 1, Pose2D(), now + 1)
        assert later.status is Status.NO_POSE


def fault_behind(kind):
    """K15: the path lies behind the robot."""
    follower = loop(kind)
    pose, now, state = Pose2D(0.0, 0.0, math.pi), 0, begun(follower)
    for _ in range(10_000):
        guidance, state = follower.step(state, now, pose, now)
        if guidance.status.stops:
            break
        pose, now = pose @ Pose2D.exp(guidance.twist * 0.01), now + PERIOD_NS
    # Ramsete may leave the path while it turns; then it says so.
    assert guidance.status in ({Status.ARRIVED, Status.OFF_PATH} if kind == "ramsete" else {Status.ARRIVED})


def there_and_back():
    return Path([Line((0.0, 0.0), (1.5, 0.0))]) + Path(
        [CircularArc(Pose2D(1.5, 0.0, math.pi), 1.0, 1.0)], backward=True
    )


def fault_cusp(kind):
    """K15: forward, a cusp, and backward round a bend."""
    path = there_and_back()
    if kind == "pursuit":
        follower = PurePursuit(path, speed=0.5, lookahead=0.2)
    else:
        trajectory = TimedPath.fastest(path, SpeedLimits(max_speed=0.5, max_acceleration=0.5))
        follower = TrajectoryFollower(trajectory, Ramsete(b=20.0) if kind == "ramsete" else HolonomicPid())
    pose, now, state = Pose2D(0.0, 0.02, 0.0), 0, begun(follower)
    backed = False
    for _ in range(10_000):
        guidance, state = follower.step(state, now, pose, now)
        if guidance.status.stops:
            break
        backed |= guidance.twist.vx < -0.1
        assert not (backed and guidance.twist.vx > 0.1)
        pose, now = pose @ Pose2D.exp(guidance.twist * 0.01), now + PERIOD_NS
    assert guidance.status is Status.ARRIVED
    assert backed
    goal = path.at(path.length).pose
    assert math.dist((pose.x, pose.y), (goal.x, goal.y)) < 0.02
    assert pose.theta == pytest.approx(goal.theta, abs=0.05)


@pytest.mark.parametrize("kind", ["ramsete", "holonomic", "pursuit"])
@pytest.mark.parametrize(
    "check",
    [
        pytest.param(fault_far_away, id="K13-50_m_away"),
        pytest.param(fault_no_pose, id="K14"),
        pytest.param(fault_behind, id="K15-path_behind"),
        pytest.param(fault_cusp, id="K15-cusp"),
    ],
)
def test_fault(check, kind):
    check(kind)


def test_what_cannot_be_followed_is_refused():
    with pytest.raises(PathError, match="facing"):
        PurePursuit(Path(COURSE, facing=(0.0, 1.0)), speed=1.0)
    assert loop("pursuit").start(Pose2D(math.nan)) == loop("pursuit").start()
    for wrong in ({"speed": 0.0}, {"speed": 1.0, "lookahead": -1.0}, {"speed": 1.0, "lookahead_time": -1.0}):
        with pytest.raises(ConfigError):
            PurePursuit(Path(COURSE), **wrong)
    with pytest.raises(ConfigError, match="zeta"):
        Ramsete(zeta=1.5)
    with pytest.raises(ConfigError, match="pose_timeout"):
        Supervision(pose_timeout=0.0)
