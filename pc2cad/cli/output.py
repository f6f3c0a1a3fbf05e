"""What the command line writes: results on stdout, one sentence or a progress line on stderr.

Nothing else writes to them. Texts may come from templates and paths: a character that is not
printable, which could move a terminal's cursor or hide what it shows, is written as its escape.
"""

from __future__ import annotations

import re
import sys
import time
import traceback
from collections.abc import Sequence
from contextlib import suppress
from threading import Lock, Timer
from typing import Any, Final, TextIO

from pc2cad.trust.names import visible

#: a message longer than this is cut: it quotes something that nobody wrote by hand
LONGEST_MESSAGE: Final = 1200
#: seconds that a stage takes before its name is shown
PATIENCE: Final = 1.0
_FIGURES: Final = re.compile(r"-|-?[0-9][-+.0-9e x]*")


def say(text: str, flush: bool = False) -> None:
    """Write the lines of a result to stdout (nowhere when it is closed)."""
    if sys.stdout is not None:
        sys.stdout.write(f"{_lines(text)}\n")
        if flush:
            sys.stdout.flush()


def complain(text: str) -> None:
    """Write one sentence to stderr, if there is anybody to read it."""
    if sys.stderr is not None:
        with suppress(OSError, ValueError):
            sys.stderr.write(f"pc2cad: {one_line(text)}\n")
            sys.stderr.flush()


def complain_at_length(error: BaseException) -> None:
    """Write where an error arose to stderr, for who develops."""
    if sys.stderr is not None:
        told = "".join(traceback.format_exception(error))
        with suppress(OSError, ValueError):
            sys.stderr.write(f"{_lines(told)}\n")


def _lines(text: str) -> str:
    return text if text.isprintable() else "\n".join(map(visible, text.split("\n")))


def one_line(text: str) -> str:
    """Return a text without line ends and control characters, cut where it is very long."""
    text = visible(" ".join(text.split()))
    if len(text) > LONGEST_MESSAGE:
        text = f"{text[: LONGEST_MESSAGE - 220]} … {text[-200:]}"
    return text


def shown(path: str) -> str:
    """Return a path for a result: quoted, on one line, where it has odd characters."""
    return path if path.isprintable() else f"'{visible(path)}'"


def tolerate_encodings() -> None:
    """Let stdout replace what its encoding lacks, instead of failing."""
    for stream in (sys.stdout, sys.stderr):
        reconfigure = getattr(stream, "reconfigure", None)
        if reconfigure is not None:
            with suppress(OSError, ValueError):
                reconfigure(errors="replace" if stream is sys.stdout else "backslashreplace")


def table(rows: Sequence[tuple[str, ...]], indent: str = "  ") -> str:
    """Return rows of cells as aligned columns; columns of figures are aligned to the right."""
    columns = []
    for cells in zip(*(map(visible, row) for row in rows), strict=True):
        cells = tuple(cells)
        width = max(map(len, cells))
        figures = len(rows) > 1 and all(_FIGURES.fullmatch(cell) for cell in cells[1:])
        columns.append([c.rjust(width) if figures else c.ljust(width) for c in cells])
    lines = zip(*columns, strict=True)
    return "\n".join((indent + "  ".join(line)).rstrip() for line in lines)


class Progress:
    """Shows on a terminal what takes long, as a bar (drawn by rich) that is gone at the end.

    Call it with the name of each stage as it begins; use it as a context manager. What is over
    soon, piped or quiet shows nothing, and loads nothing.
    """

    def __init__(self, quiet: bool = False, stream: TextIO | None = None) -> None:
        self._stream = stream or sys.stderr
        self._active = not quiet and self._stream is not None and self._stream.isatty()
        self._timer: Timer | None = None
        self._lock = Lock()
        self._due = time.monotonic() + PATIENCE
        self._bar: Any = None
        self._line = False

    def first(self, stage: str) -> None:
        """Say at once, in plain text, what begins: nothing else can be drawn while it lasts."""
        if self._active:
            with self._lock, suppress(OSError, ValueError):
                self._stream.write(f"{one_line(stage)} …")
                self._stream.flush()
                self._line = True

    def _wipe(self) -> None:
        if self._line:
            self._line = False
            with suppress(OSError, ValueError):
                self._stream.write("\r\x1b[2K")
                self._stream.flush()

    def update(self, state: str, finished: int, total: int) -> None:
        """Show how far a long stage is."""
        if self._active and time.monotonic() >= self._due:
            with self._lock:
                self._draw(state, finished, total)

    def __call__(self, stage: str) -> None:
        """Begin a stage."""
        if not self._active:
            return
        with self._lock:
            self._wipe()
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            if self._bar is not None:
                self._draw(stage)
                return
            self._timer = Timer(PATIENCE, self._show, (stage,))
            self._timer.daemon = True
            self._timer.start()

    def __enter__(self) -> Progress:
        return self

    def __exit__(self, *error: object) -> None:
        with self._lock:
            self._wipe()
            if self._timer is not None:
                self._timer.cancel()
                self._timer = None
            if self._bar is not None:
                with suppress(OSError, ValueError):
                    self._bar.stop()

    def _show(self, stage: str) -> None:
        with self._lock:
            if self._timer is not None:
                self._draw(stage)

    def _draw(self, text: str, finished: int = 0, total: int | None = None) -> None:
        """Show a stage; the bar moves to and fro where nothing is counted."""
        self._wipe()
        with suppress(OSError, ValueError):
            if self._bar is None:
                self._bar = _bar(self._stream)
                self._bar.add_task(one_line(text), total=total)
                self._bar.start()
            self._bar.update(0, description=one_line(text), completed=finished, total=total)


def _bar(stream: TextIO) -> Any:
    from rich.console import Console
    from rich.progress import BarColumn, TextColumn, TimeElapsedColumn
    from rich.progress import Progress as Bar

    class Screen(Console):
        def show_cursor(self, show: bool = True) -> bool:
            return False  # it stays: a process that is killed could not bring it back

    columns = (BarColumn(24), TimeElapsedColumn(), TextColumn("{task.description}", markup=False))
    return Bar(*columns, console=Screen(file=stream), transient=True)
