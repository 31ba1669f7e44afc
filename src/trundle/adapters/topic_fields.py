"""Which field of a message holds what, by its type."""

from __future__ import annotations

from trundle.errors import LogSchema

__all__ = ["pose_fields", "scalar_field", "twist_fields"]

_PLAIN_NUMBERS = (
    "Float64",
    "Float32",
    "Int64",
    "Int32",
    "Int16",
    "Int8",
    "UInt64",
    "UInt32",
    "UInt16",
    "UInt8",
)

# Where the twist, the position and the rotation stand.
_TWIST = {
    "geometry_msgs/msg/Twist": "",
    "geometry_msgs/msg/TwistStamped": "twist.",
    "geometry_msgs/msg/TwistWithCovariance": "twist.",
    "geometry_msgs/msg/TwistWithCovarianceStamped": "twist.twist.",
    "nav_msgs/msg/Odometry": "twist.twist.",
}
_WPILIB_TWISTS = ("struct:ChassisSpeeds", "struct:ChassisVelocities")
_POSE = {
    "geometry_msgs/msg/Pose": ("position.", "orientation."),
    "geometry_msgs/msg/PoseStamped": ("pose.position.", "pose.orientation."),
    "geometry_msgs/msg/PoseWithCovariance": ("pose.position.", "pose.orientation."),
    "geometry_msgs/msg/PoseWithCovarianceStamped": ("pose.pose.position.", "pose.pose.orientation."),
    "geometry_msgs/msg/Transform": ("translation.", "rotation."),
    "geometry_msgs/msg/TransformStamped": ("transform.translation.", "transform.rotation."),
    "geometry_msgs/msg/Point": ("", None),
    "geometry_msgs/msg/PointStamped": ("point.", None),
    "nav_msgs/msg/Odometry": ("pose.pose.position.", "pose.pose.orientation."),
    "foxglove_msgs/msg/PoseInFrame": ("pose.position.", "pose.orientation."),
    "struct:Pose3d": ("translation.", "rotation.q."),
    "struct:Translation2d": ("", None),
}
_PLANAR_POSE = {
    "geometry_msgs/msg/Pose2D": (["x", "y"], ["theta"]),
    "struct:Pose2d": (["translation.x", "translation.y"], ["rotation.value"]),
    # As WPILib's Field2d writes them: x, y, heading, of each of its objects.
    "double[]": (["value.0", "value.1"], ["value.2"]),
}


def scalar_field(source: object, topic: str, kind: str, *, speed: bool) -> str:
    """The field that a mapping means that names none.

    Args:
        source: The recording, for errors.
        topic: Topic, for errors.
        kind: Type of its messages.
        speed: Whether a speed is meant where the type holds positions as well.

    Raises:
        LogSchema: If this type has no obvious one.
    """
    if kind == "sensor_msgs/msg/JointState":
        return "velocity" if speed else "position"
    if kind == "sensor_msgs/msg/Imu":
        return "angular_velocity.z"
    package, _, name = kind.rpartition("/")
    if package == "std_msgs/msg" and name.removesuffix("MultiArray") in _PLAIN_NUMBERS:
        return "data"
    if kind in ("boolean", "int64", "float", "double", "struct:Rotation2d"):
        return "value"
    raise LogSchema(source, "field", f"{topic} is {kind}: say which field")


def twist_fields(source: object, topic: str, kind: str) -> list[str]:
    """Fields of vx, vy and omega.

    Raises:
        LogSchema: If this type holds no twist.
    """
    if kind in _WPILIB_TWISTS:
        return ["vx", "vy", "omega"]
    if kind not in _TWIST:
        allowed = ", ".join((*_TWIST, *_WPILIB_TWISTS))
        raise LogSchema(source, "type", f"{topic} is {kind}, must be one of {allowed}")
    return [_TWIST[kind] + part for part in ("linear.x", "linear.y", "angular.z")]


def pose_fields(source: object, topic: str, kind: str) -> tuple[list[str], list[str]]:
    """Fields of x and y, and of the rotation: a heading, a quaternion's x, y, z, w, or nothing.

    Raises:
        LogSchema: If this type holds no pose.
    """
    if kind in _PLANAR_POSE:
        return _PLANAR_POSE[kind]
    if kind not in _POSE:
        allowed = ", ".join((*_POSE, *_PLANAR_POSE))
        raise LogSchema(source, "type", f"{topic} is {kind}, must be one of {allowed}")
    position, rotation = _POSE[kind]
    quaternion = [] if rotation is None else [rotation + part for part in "xyzw"]
    return [position + "x", position + "y"], quaternion
