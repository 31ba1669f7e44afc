"""What a command tells the shell: the one place where errors become numbers."""

from __future__ import annotations

import enum

from trundle.errors import ConfigError, Infeasible, InputError, LogError, TrundleError

__all__ = ["ExitCode", "exit_code_of"]


class ExitCode(enum.IntEnum):
    """Exit codes of every command, as FAULTS.md promises them."""

    FINE = 0
    BUG = 1
    """Trundle itself failed: an error that nobody foresaw."""
    USAGE = 2
    """The command line or a configuration is wrong, or asks for what the robot cannot do."""
    DATA = 3
    """An input file does not hold what is needed."""
    PARTIAL = 4
    """There is a result, but part of the input was lost."""
    ENVIRONMENT = 5
    """Disk, permission, memory, or a package that is not installed."""
    FOUND = 6
    """A check (doctor, lint) found a fault: what it was asked for, and no failure of its own."""
    UNDECIDED = 7
    """A check cannot tell: its input is sound, and says too little or contradicts itself."""
    INTERRUPTED = 130
    """Ctrl-C."""


def exit_code_of(error: BaseException) -> ExitCode:
    """What an error means to a shell."""
    if isinstance(error, KeyboardInterrupt):
        return ExitCode.INTERRUPTED
    if isinstance(error, ConfigError | InputError | Infeasible):
        return ExitCode.USAGE
    if isinstance(error, OSError | MemoryError | ImportError):
        return ExitCode.ENVIRONMENT
    if isinstance(error, LogError) and error.reason in ("unreadable", "changed"):
        return ExitCode.ENVIRONMENT
    return ExitCode.DATA if isinstance(error, TrundleError) else ExitCode.BUG
