"""`python -m trundle` is `trundle`: what can be interrupted while the rest is still loading."""

from __future__ import annotations

import sys

__all__ = ["main"]


def main() -> int:
    """Run the command line.

    Returns:
        The exit code, see `ExitCode`.
    """
    try:
        from trundle.apps.cli import main as run

        return run()
    except KeyboardInterrupt:
        sys.stderr.write("trundle: interrupted\n")
        return 130


if __name__ == "__main__":
    sys.exit(main())
