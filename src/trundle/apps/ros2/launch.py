"""`trundle ros2`: a described robot, real or simulated, live on ROS 2."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FrameType
from typing import Annotated, Any

from cyclopts import Parameter

from trundle.apps.exit_code import ExitCode

__all__ = ["ros2"]


def ros2(
    *ros_arguments: Annotated[str, Parameter(allow_leading_hyphen=True, show=False)],
    robot: Path,
    simulate: Annotated[bool, Parameter(negative="", show_default=False)] = False,
    seed: int = 0,
    node_name: str = "trundle",
    autostart: bool = True,
) -> int:
    """Publish a robot's odometry and drive its wheels, safely, until Ctrl-C.

    What ROS itself understands comes last, behind `--`: -- --ros-args -r cmd_vel:=/nav/cmd_vel

    Args:
        ros_arguments: For rclpy, from `--ros-args` on: remappings and parameters.
        robot: The robot's description (robot.yaml); its log: section says which joints are its wheels.
        simulate: Drive a robot that does not exist: publishes joint_states and ground_truth as well.
        seed: Of the simulated robot's noise.
        node_name: Name of the node.
        autostart: Configure and activate at once; otherwise a lifecycle manager does.
    """
    from trundle.adapters.robot_yaml import load_robot
    from trundle.apps.ros2.installation import require_rclpy

    described = load_robot(robot)
    require_rclpy()
    from trundle.apps.ros2.node import RobotNode
    from trundle.apps.ros2.simulator import SimulatorNode

    with _stopped_by_signals() as stopped, _context(ros_arguments) as executor:
        live = RobotNode(described, name=node_name)
        try:
            executor.add_node(live.node)
            simulator = SimulatorNode(described, seed=seed) if simulate else None
            if simulator is not None:
                executor.add_node(simulator.node)
            if autostart:
                live.start()
            while not stopped():
                executor.spin_once(timeout_sec=0.1)
        finally:
            live.close()
        return stopped()


@contextmanager
def _stopped_by_signals() -> Iterator[Callable[[], int]]:
    """The exit code that a signal asks for, 0 as long as none came.

    A flag, not an exception: nothing is cut off in the middle, and the wheels are stopped behind the loop.
    """
    codes = {signal.SIGINT: int(ExitCode.INTERRUPTED), signal.SIGTERM: 128 + signal.SIGTERM}
    came: list[int] = []

    def note(number: int, _frame: FrameType | None) -> None:
        came.append(codes[signal.Signals(number)])

    before = {number: signal.signal(number, note) for number in codes}
    try:
        yield lambda: came[0] if came else 0
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@contextmanager
def _context(arguments: tuple[str, ...]) -> Iterator[Any]:
    """rclpy, and the leanest executor that it has.

    Raises:
        InputError: If rclpy does not understand the arguments.
    """
    import rclpy
    from rclpy.signals import SignalHandlerOptions

    from trundle.errors import InputError

    try:
        rclpy.init(args=list(arguments), signal_handler_options=SignalHandlerOptions.NO)
    except (RuntimeError, ValueError, TypeError) as error:
        raise InputError(f"arguments for ROS {' '.join(arguments)}: {error}") from None
    try:
        executor = _executor()
        yield executor
    finally:
        rclpy.try_shutdown()


def _executor() -> Any:
    """Events where rclpy has them (Kilted and later), which halves the work of a message."""
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        from rclpy.executors import SingleThreadedExecutor

        return SingleThreadedExecutor()
    return EventsExecutor()
