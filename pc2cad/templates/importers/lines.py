"""Texts of other programs, read line by line within limits, and numbers written for templates."""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path
from typing import Final, NoReturn

from pc2cad.errors import InputError
from pc2cad.trust.files import FileNotReadError, read_regular
from pc2cad.trust.names import clean, visible

LARGEST_FILE: Final = 1024 * 1024
MOST_LINES: Final = 20_000
LONGEST_LINE: Final = 4000
#: a decimal number as Fortran and C write it; no other is read
NUMBER: Final = re.compile(
    r"[+-]?(?:[0-9]{1,40}\.?[0-9]{0,40}|\.[0-9]{1,40})(?:[eEdD][+-]?[0-9]{1,3})?\Z", re.ASCII
)


class FileNotReadableError(InputError):
    """A file to import is not of its format; the message names file and line."""


@dataclass(frozen=True)
class Source:
    """A text file: its name for messages, and its lines."""

    name: str
    lines: tuple[str, ...]

    def fail(self, line: int, what: str) -> NoReturn:
        """Raise FileNotReadableError for a line (from 1; 0 for the whole file)."""
        where = f"{self.name}: line {line}" if line else self.name
        raise FileNotReadableError(f"{where}: {what}")

    def number(self, line: int, text: str, what: str = "a number") -> Fraction:
        """Return a finite number, exactly as it is written."""
        if not NUMBER.match(text):
            self.fail(line, f"{what} is expected, and '{shown(text)}' was found")
        plain = text.lower().replace("d", "e")
        exponent = int(plain.partition("e")[2] or 0)
        if abs(exponent) > 60:
            if float(plain) == 0 or exponent < 0:
                return Fraction(0)
            self.fail(line, f"{shown(text)} is outside the range 1e-60 to 1e60")
        return Fraction(plain)

    def numbers(self, line: int, texts: Iterable[str]) -> list[Fraction]:
        """Return finite numbers (see `number`)."""
        return [self.number(line, text) for text in texts]


def read_lines(path: str | os.PathLike[str]) -> Source:
    """Return the lines of a text file; raise FileNotReadableError where it is none, or too large.

    Bytes that are no UTF-8 are taken for what stands in comments, and replaced.
    """
    name = visible(str(path))[-200:]
    empty = Source(name, ())
    try:
        raw = read_regular(Path(path), LARGEST_FILE)
    except FileNotReadError as error:
        empty.fail(0, str(error))
    if b"\0" in raw:
        empty.fail(raw.count(b"\n", 0, raw.index(b"\0")) + 1, "a zero byte: this is no text file")
    lines = raw.decode("utf-8-sig", errors="replace").replace("\r\n", "\n").replace("\r", "\n")
    rows = tuple(lines.split("\n"))
    if len(rows) > MOST_LINES:
        empty.fail(MOST_LINES + 1, f"the file has more than {MOST_LINES} lines")
    for i, row in enumerate(rows):
        if len(row) > LONGEST_LINE:
            empty.fail(i + 1, f"the line is longer than {LONGEST_LINE} characters")
    return Source(name, rows)


def shown(text: str) -> str:
    """Return a short piece of a file, safe for a message."""
    return visible(text if len(text) <= 40 else f"{text[:40]}…")


# -- templates -------------------------------------------------------------------------------------


def written(value: Fraction | float) -> str:
    """Return a number as a template writes it."""
    near = float(value)
    if near == int(near) and abs(near) < 1e15:
        return str(int(near))
    return repr(near)


def quoted(text: str) -> str:
    """Return a text of one line in quotes, as TOML has them."""
    escaped = clean(text).replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'


def named_after(path: str | os.PathLike[str]) -> str:
    """Return the name of a file for titles."""
    return clean(Path(path).name)[:80] or "a file"


def table(rows: Iterable[Iterable[Fraction | float]], per_line: int = 4) -> Iterator[str]:
    """Yield lines of rows of numbers, [a, b, c], several to a line."""
    cells = [f"[{', '.join(written(x) for x in row)}]," for row in rows]
    for start in range(0, len(cells), per_line):
        yield "    " + " ".join(cells[start : start + per_line])
