"""What readers tell each other about broken bytes, before it becomes an error with a file name or a loss."""

from __future__ import annotations

__all__ = ["Damage"]


class Damage(Exception):
    """Bytes that contradict themselves. The words follow the name of the part that they are of."""
