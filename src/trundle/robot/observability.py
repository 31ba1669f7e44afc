"""Whether a set of rows determines a body twist, and if not, what it leaves open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from trundle.errors import ConfigError, Singular
from trundle.robot.rows import Row
from trundle.robot.traced import nominal

__all__ = ["CONDITION_LIMIT", "check_constraints", "check_observable", "independent", "length_scale"]

CONDITION_LIMIT = 1e6
_FARTHEST = 1e6  # [m]: no robot
_DEPENDENT = 1e-9

Points = Sequence[tuple[float, float]]


def length_scale(points: Points) -> tuple[float, float, float]:
    """Centroid of the wheels and their RMS distance from it [m]; 1 m if they all stand there."""
    xs, ys = zip(*((nominal(x), nominal(y)) for x, y in points), strict=True)
    cx, cy = math.fsum(xs) / len(xs), math.fsum(ys) / len(ys)
    far = [math.hypot(x - cx, y - cy) for x, y in zip(xs, ys, strict=True)]
    if max(far) > _FARTHEST:
        raise ConfigError("wheels", f"stand {max(far):.3g} m from their middle, must be nearer")
    return cx, cy, math.sqrt(math.fsum(d * d for d in far) / len(far)) or 1.0


def independent(rows: Sequence[Row], points: Points) -> list[int]:
    """Indices of the rows that are not combinations of earlier ones."""
    import numpy as np

    scaled = _scaled(rows, points)
    chosen: list[int] = []
    basis: list[Any] = []
    for index, row in enumerate(scaled):
        rest = row.copy()
        for _ in range(2):  # once more: twice is enough (Kahan)
            for q in basis:
                rest -= (q @ rest) * q
        size = np.linalg.norm(rest)
        if size > _DEPENDENT * np.linalg.norm(row):
            basis.append(rest / size)
            chosen.append(index)
    return chosen


def check_constraints(motions: Sequence[Sequence[float]]) -> None:
    """Refuse drives whose wheels would have to slip for every turn.

    Args:
        motions: Columns that span the twists which the constraints allow.

    Raises:
        ConfigError: If there are none, or none that turns.
    """
    if not any(abs(nominal(column[2])) > 0.0 for column in motions):
        raise ConfigError(
            "wheels",
            "the fixed wheels leave the robot "
            + ("no way to turn" if motions else "no motion at all")
            + "; these wheels must slip: give them kind='skid' (or steer some of them)",
        )


def check_observable(rows: Sequence[Row], points: Points) -> float:
    """Condition number of the stacked rows.

    Raises:
        Singular: If it is above CONDITION_LIMIT, with the motion that the rows do not see.
    """
    import numpy as np

    matrix = np.array(_scaled(rows, points))
    if len(matrix) < 3:
        matrix = np.vstack([matrix.reshape(-1, 3), np.zeros((3 - len(matrix), 3))])
    _, values, directions = np.linalg.svd(matrix)
    condition = float(values[0] / values[2]) if values[2] > 0.0 else math.inf
    if condition > CONDITION_LIMIT:
        raise Singular(
            "wheels",
            f"condition number {condition:.3g} (limit {CONDITION_LIMIT:.0e}): what is measured says "
            f"nothing about {_in_words(directions[2])}; add a wheel, a gyro, or place the wheels differently",
        )
    return condition


def _scaled(rows: Sequence[Row], points: Points) -> list[Any]:
    """The rows for the twist of the wheels' centroid, with omega measured at the RMS distance."""
    import numpy as np

    cx, cy, scale = length_scale(points)
    # vx = vx' + omega cy and vy = vy' - omega cx, where ' is the centroid.
    known = [(nominal(a), nominal(b), nominal(turn)) for a, b, turn in rows]
    return [np.array([a, b, (turn + a * cy - b * cx) / scale]) for a, b, turn in known]


def _in_words(direction: Any) -> str:
    words = ("driving forward (vx)", "moving sideways (vy)", "turning (omega)")
    strongest = max(range(3), key=lambda i: abs(direction[i]))
    if abs(direction[strongest]) > 0.99:
        return words[strongest]
    parts = zip(direction, ("vx", "vy", "omega * wheel distance"), strict=True)
    mix = ", ".join(f"{value:+.2f} {name}" for value, name in parts if abs(value) > 0.01)
    return f"the motion ({mix})"
