"""Parts for a donkeycar `Vehicle`, by donkeycar's names: same arguments, results, units and signs.

    from trundle.donkeycar import Bicycle, UnnormalizeSteeringAngle

    V.add(UnnormalizeSteeringAngle(cfg.MAX_STEERING_ANGLE), inputs=["steering"], outputs=["steering/angle"])
    V.add(Bicycle(cfg.WHEEL_BASE), inputs=["enc/distance", "steering/angle", "timestamp"],
          outputs=["odom/distance", "odom/velocity", "pos/x", "pos/y", "pos/angle",
                   "vel/x", "vel/y", "vel/angle", "odom/timestamp"])

Where donkeycar is wrong these are right; `parity=True` computes as donkeycar does. docs/classics.md lists
the differences.
"""

from trundle.apps.donkeycar.pose import (
    Bicycle,
    Pose2D,
    Unicycle,
    limit_angle,
    update_bicycle_front_wheel_pose,
)
from trundle.apps.donkeycar.steering import (
    NormalizeSteeringAngle,
    TwoWheelSteeringThrottle,
    UnnormalizeSteeringAngle,
    differential_steering,
)
from trundle.apps.donkeycar.velocity import (
    BicycleNormalizeAngularVelocity,
    BicycleUnnormalizeAngularVelocity,
    InverseBicycle,
    InverseUnicycle,
    UnicycleNormalizeAngularVelocity,
    UnicycleUnnormalizeAngularVelocity,
    bicycle_angular_velocity,
    bicycle_steering_angle,
    unicycle_angular_velocity,
    unicycle_max_angular_velocity,
    wheel_rotational_velocity,
)

__all__ = [
    "Bicycle",
    "BicycleNormalizeAngularVelocity",
    "BicycleUnnormalizeAngularVelocity",
    "InverseBicycle",
    "InverseUnicycle",
    "NormalizeSteeringAngle",
    "Pose2D",
    "TwoWheelSteeringThrottle",
    "Unicycle",
    "UnicycleNormalizeAngularVelocity",
    "UnicycleUnnormalizeAngularVelocity",
    "UnnormalizeSteeringAngle",
    "bicycle_angular_velocity",
    "bicycle_steering_angle",
    "differential_steering",
    "limit_angle",
    "unicycle_angular_velocity",
    "unicycle_max_angular_velocity",
    "update_bicycle_front_wheel_pose",
    "wheel_rotational_velocity",
]
