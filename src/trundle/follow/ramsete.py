"""Ramsete: a trajectory follower for drives that cannot move sideways."""

from __future__ import annotations

import math

import msgspec

from trundle.errors import ConfigError, require_finite, require_positive
from trundle.follow.timed_path import Reference
from trundle.geometry import Pose2D, Twist2D, wrap
from trundle.geometry.angle import sinc

__all__ = ["Ramsete"]


class Ramsete(msgspec.Struct, frozen=True, kw_only=True):
    """Nonlinear feedback about a reference that moves.

    Attributes:
        b: How hard errors along the path are driven out [rad^2/m^2], above zero.
        zeta: Damping, between 0 and 1.

    Source:
        De Luca, Oriolo, Vendittelli 2001, "Control of wheeled mobile robots: an experimental overview",
        eq. 5.12: with the error (e_x, e_y, e_theta) of the reference in the robot's frame and
        k = 2 zeta sqrt(omega_r^2 + b v_r^2), `v = v_r cos(e_theta) + k e_x` and
        `omega = omega_r + k e_theta + b v_r sinc(e_theta) e_y`. (Road Runner 1.0's comment has another
        lateral term; its code has this one.)
    """

    b: float = 2.0
    zeta: float = 0.7

    def __post_init__(self) -> None:
        require_positive("b", self.b)
        if not 0.0 < require_finite("zeta", self.zeta) < 1.0:
            raise ConfigError("zeta", f"{self.zeta!r}, must be between 0 and 1")

    def start(self) -> None:
        """It remembers nothing."""

    def step(self, state: None, reference: Reference, pose: Pose2D, dt: float) -> tuple[Twist2D, None]:
        """The body twist, and nothing to remember; see `command`."""
        del state, dt
        return self.command(reference, pose), None

    def command(self, reference: Reference, pose: Pose2D) -> Twist2D:
        """The body twist that leads from a pose to where the reference moves.

        Args:
            reference: Its twist must not have a sideways part.
            pose: The robot's.
        """
        error = pose.inverse() @ reference.pose
        turn = wrap(error.theta)
        speed, omega = reference.twist.vx, reference.twist.omega
        gain = 2.0 * self.zeta * math.sqrt(omega * omega + self.b * speed * speed)
        return Twist2D(
            speed * math.cos(turn) + gain * error.x,
            0.0,
            omega + gain * turn + self.b * speed * sinc(turn) * error.y,
        )
