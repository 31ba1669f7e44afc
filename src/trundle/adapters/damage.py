"""What readers tell each other about broken bytes, before it becomes an error with a file name or a loss."""

from __future__ import annotations

import mmap

__all__ = ["Damage", "require_mapped"]


class Damage(Exception):
    """Bytes that contradict themselves. The words follow the name of the part that they are of."""


def require_mapped(mapping: mmap.mmap) -> None:
    """Refuse to read on in a file that became shorter: the system kills whoever reads behind its end.

    Raises:
        Damage: If it did.
    """
    if mapping.size() < len(mapping):
        raise Damage(f"was cut off while it was read: of {len(mapping)} bytes there are {mapping.size()}")
