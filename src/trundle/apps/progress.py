"""What a long job is doing just now."""

from __future__ import annotations

import sys
import threading
from types import TracebackType
from typing import Any, Self

__all__ = ["Progress"]

PATIENCE = 1.0  # [s] before anything is shown: most jobs are done by then


class Progress:
    """A bar on a terminal's stderr, once a job turns out to be long; elsewhere nothing at all.

    Args:
        steps: How many times `step` will be called.
    """

    def __init__(self, steps: int) -> None:
        self._steps = steps
        self._done = -1
        self._doing = ""
        self._detail = ""
        self._bar: Any = None
        self._lock = threading.Lock()
        self._timer = threading.Timer(PATIENCE, self._show)
        self._timer.daemon = True

    def __enter__(self) -> Self:
        if sys.stderr is not None and sys.stderr.isatty():
            self._timer.start()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._timer.cancel()
        with self._lock:
            self._steps = 0  # a timer that has just fired shows nothing any more
            if self._bar is not None:
                self._bar.stop()

    def step(self, doing: str) -> None:
        """The step before is done; this is what comes now."""
        with self._lock:
            self._done += 1
            self._doing = doing
            self._detail = ""
            if self._bar is not None:
                self._update()

    def detail(self, words: str) -> None:
        """How far the present step is."""
        with self._lock:
            self._detail = f": {words}"
            if self._bar is not None:
                self._update()

    def _show(self) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, SpinnerColumn, TextColumn, TimeElapsedColumn
        from rich.progress import Progress as RichProgress

        columns = (SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), TimeElapsedColumn())
        with self._lock:
            if self._steps:
                self._bar = RichProgress(*columns, console=Console(stderr=True), transient=True)
                self._bar.add_task("", total=self._steps)
                self._update()
                self._bar.start()

    def _update(self) -> None:
        from rich.markup import escape

        words = escape(self._doing + self._detail)
        self._bar.update(self._bar.task_ids[0], completed=self._done, description=words)
