"""The command line: `trundle VERB ...`.

Arguments are parsed before anything heavy is loaded: each verb lives in a module of its own that is
imported when it is called, and loads what it needs inside.
"""

from __future__ import annotations

import codecs
import contextlib
import io
import os
import signal
import sys
import threading
import traceback
from collections.abc import Iterator, Sequence
from types import FrameType

from cyclopts import App, CycloptsError
from cyclopts.exceptions import MissingArgumentError, UnusedCliTokensError

from trundle.apps.exit_code import ExitCode, exit_code_of
from trundle.errors import TrundleError

__all__ = ["main"]

_VERBS = {
    "track": ("trundle.apps.track:track", "Wheel log to trajectory, with a summary and a picture."),
    "calibrate": ("trundle.apps.calibrate:calibrate", "Logs to a robot with better numbers."),
    "plan": ("trundle.apps.plan:plan", "How well drives would calibrate a robot, before they are driven."),
    "compare": ("trundle.apps.compare:compare", "How far a trajectory is from a reference."),
    "info": ("trundle.apps.info:info", "What is in a log, and a log: section for it to start from."),
    "convert": ("trundle.apps.convert:convert", "The same trajectory, log or robot in another format."),
    "ros2": ("trundle.apps.ros2.launch:ros2", "A robot, real or simulated, live on ROS 2."),
    "doctor": ("trundle.apps.doctor:doctor", "What is swapped, reversed, frozen or in the wrong unit."),
    "lint": ("trundle.apps.lint:lint", "What is likely to be wrong in a ROS 2 controller's parameters."),
    "inverse": ("trundle.apps.kinematics:inverse", "Body twist to wheel speeds and steering angles."),
    "forward": ("trundle.apps.kinematics:forward", "Wheel speeds and steering angles to a body twist."),
}


def main(tokens: Sequence[str] | None = None) -> int:
    """Run a command.

    Args:
        tokens: What was typed after `trundle`; by default what really was.

    Returns:
        The exit code, see `ExitCode`.
    """
    words = list(sys.argv[1:] if tokens is None else tokens)
    debug = "--debug" in words
    words = [word for word in words if word != "--debug"]
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors=_PLAIN)
    with _terminated_cleanly():
        try:
            code = _app()(words, exit_on_error=False, print_error=False)
            if sys.stdout is not None:
                sys.stdout.flush()
        except BrokenPipeError:
            _close_stdout()  # whoever read it has seen enough
            return ExitCode.FINE
        except SystemExit as ended:
            if ended.code != 1:
                raise
            return ExitCode.FINE  # rich, whose help nobody reads any more
        except (Exception, KeyboardInterrupt) as error:  # noqa: BLE001 - the one place where errors end
            return _report(error, debug=debug)
    return int(code or ExitCode.FINE)


def _app() -> App:
    app = App(
        name="trundle",
        help="Drive kinematics and wheel odometry for wheeled robots.",
        help_epilogue="--debug, anywhere, shows where an error came from.",
        help_format="plaintext",
        version=_version,
        result_action="return_value",
        suppress_keyboard_interrupt=False,
    )
    for order, (name, (home, words)) in enumerate(_VERBS.items()):
        app.command(home, name=name, help=words, sort_key=order)
    return app


def _version() -> str:
    from importlib.metadata import version

    return version("trundle")


def _report(error: BaseException, *, debug: bool) -> int:
    """Say on stderr what went wrong, and return the exit code."""
    code = ExitCode.USAGE if isinstance(error, CycloptsError) else exit_code_of(error)
    if debug:
        words = "".join(traceback.format_exception(error)).rstrip()
    elif isinstance(error, KeyboardInterrupt):
        words = "trundle: interrupted"
    elif isinstance(error, CycloptsError):
        words = _usage_problem(error)
    elif isinstance(error, TrundleError):
        words = f"trundle: {error}"
    elif isinstance(error, OSError):
        where = f"{os.fsdecode(error.filename)}: " if isinstance(error.filename, str | bytes) else ""
        words = f"trundle: {where}{error.strerror or error}"
    elif isinstance(error, MemoryError):
        words = "trundle: not enough memory"
    else:
        words = (
            f"trundle: internal error: {type(error).__name__}: {error}\n"
            "This is a fault of trundle; --debug shows where it happened."
        )
    with contextlib.suppress(OSError):  # nobody listens
        print(words, file=sys.stderr, flush=True)
    if isinstance(error, OSError) and sys.stdout is not None:
        _close_if_broken()
    return code


def _usage_problem(error: CycloptsError) -> str:
    command = " ".join(("trundle", *(error.command_chain or ())))
    problem = str(error).partition(" Available commands:")[0].strip().rstrip(".")
    if isinstance(error, MissingArgumentError) and error.argument is not None and not error.argument.tokens:
        problem = f"needs {error.argument.name}"
    if isinstance(error, UnusedCliTokensError):
        problem = f"takes no further {' '.join(error.unused_tokens or ())}"
    return f"{command}: {problem}; see {command} --help"


# --- streams and signals ------------------------------------------------------------------------


def _plain_text(error: UnicodeError) -> tuple[str | bytes, int]:
    """What stands for characters that a terminal cannot show."""
    if not isinstance(error, UnicodeEncodeError):
        raise error
    shown = error.object[error.start : error.end].replace("±", "+-")
    return shown.encode("ascii", "backslashreplace").decode("ascii"), error.end


_ENDINGS = ("SIGTERM", "SIGHUP")  # Windows knows the first only
_PLAIN = "trundle.plain"
codecs.register_error(_PLAIN, _plain_text)


def _close_if_broken() -> None:
    """Where what is left in stdout cannot be written either, Python's exit must not try it again."""
    try:
        sys.stdout.flush()
    except OSError:
        _close_stdout()


def _close_stdout() -> None:
    with contextlib.suppress(OSError, ValueError):
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


@contextlib.contextmanager
def _terminated_cleanly() -> Iterator[None]:
    """SIGTERM, and SIGHUP of a terminal that is gone, end the program through its `finally` blocks.

    So no half-written file is left. Under `nohup` SIGHUP is ignored, and stays so.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return

    def leave(number: int, _frame: FrameType | None) -> None:
        raise SystemExit(128 + number)

    numbers = [number for name in _ENDINGS if (number := getattr(signal, name, None)) is not None]
    before = {number: signal.getsignal(number) for number in numbers}
    for number, handler in before.items():
        if handler is not signal.SIG_IGN:
            signal.signal(number, leave)
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
