"""The journal of a study: one line per finished variant, on the disk before it is counted.

The journal is the truth; the results table is made from it. Its first line says what the study is,
so that it is gone on with as what it was. A process that dies leaves at most one torn line at the
end, which is cut off when the study is resumed. Of the other files in the study's folder the
journal names those that are the study's own; a file that it does not name is somebody else's.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from typing import Any, BinaryIO, Final

from pc2cad.errors import FileNotWrittenError, InputError
from pc2cad.export.files import write_atomically
from pc2cad.studies.entries import Plain, differences, read_outcome
from pc2cad.studies.variant import Outcome

#: gives the names of what is there already of files that a study will write
Present = Callable[[], Sequence[str]]

NAME: Final = "journal.jsonl"
#: a line that is longer, in bytes, is no outcome
LONGEST_LINE: Final = 1 << 20


class JournalInUseError(InputError):
    """Another process works on the same study."""


class StudyDiffersError(InputError):
    """The folder holds another study, or one that was not asked to go on."""


class NotOursError(InputError):
    """Something that pc2cad did not write has the name of a file of the study."""


class Journal:
    """An open journal: the outcomes it holds, and a way to add one.

    `study` is what the study is, as plain data; a journal of another one is not gone on with.
    `own` are the files that the study will write, by names that the journal notes before.
    Raises JournalInUseError, StudyDiffersError, NotOursError or FileNotWrittenError when it is
    opened.
    """

    def __init__(
        self, folder: Path, study: Plain, resume: bool, own: Mapping[str, Present] | None = None
    ) -> None:
        self.outcomes: dict[str, Outcome] = {}
        #: lines that hold no outcome
        self.unread = 0
        self._own: set[str] = set()
        self._folder = folder
        self._path = folder / NAME
        is_new = self._made(study, own or {})
        self._file = self._opened()
        try:
            _lock(self._file, folder)
            self._begin(study, resume or is_new)
            self._claim(own or {})
        except BaseException:
            self._file.close()
            raise

    def _made(self, study: Plain, own: Mapping[str, Present]) -> bool:
        """Make the journal with its first line; say whether there was none."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            if os.path.lexists(self._path):
                return False
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise FileNotWrittenError(
                f"the journal {self._path} cannot be written: {reason}"
            ) from error
        self._check_free(own)
        try:
            write_atomically(self._path, _line({"study": study, "own": list(own)}), new=True)
        except FileNotWrittenError:
            if os.path.lexists(self._path):  # another process was faster
                return False
            raise
        return True

    def _opened(self) -> BinaryIO:
        # neither through a link nor waiting for the other end of a pipe
        flags = os.O_RDWR | os.O_APPEND
        for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC", "O_BINARY"):
            flags |= getattr(os, name, 0)
        try:
            descriptor = os.open(self._path, flags)
        except OSError as error:
            told = f"cannot be written: {error.strerror}"
            if self._path.is_symlink():
                is_file = self._path.is_file() or not self._path.exists()
                told = f"is a {'symbolic link' if is_file else 'device'}, not a file"
            raise FileNotWrittenError(f"the journal {self._path} {told}") from error
        if not stat.S_ISREG(os.fstat(descriptor).st_mode):
            os.close(descriptor)
            raise FileNotWrittenError(f"the journal {self._path} is a device, not a file")
        return os.fdopen(descriptor, "r+b")

    def _begin(self, study: Plain, resume: bool) -> None:
        lines = _lines(self._file)
        first, _ = next(lines, (b"", 0))
        header = _parsed(first)
        if header is None or "study" not in header:
            raise NotOursError(f"{self._path} is no journal of pc2cad's; choose another folder")
        different = differences(header["study"], study)
        if different:
            raise StudyDiffersError(
                f"{self._folder} holds another study: {'; '.join(different)}; choose another folder"
            )
        if not resume:
            raise StudyDiffersError(
                f"{self._folder} holds this study already; go on with it by --resume, or choose "
                "another folder"
            )
        self._note(header.get("own"))
        self._read(lines)

    def _read(self, lines: Iterator[tuple[bytes, int]]) -> None:
        for line, start in lines:
            if not line.endswith(b"\n") and len(line) <= LONGEST_LINE:
                self._file.truncate(start)
                return
            data = _parsed(line)
            if data is not None and set(data) == {"own"}:
                self._note(data["own"])
                continue
            outcome = None if data is None else read_outcome(data)
            if outcome is None:
                self.unread += 1
            else:
                self.outcomes[outcome.key] = outcome

    def _note(self, names: Any) -> None:
        if isinstance(names, list):
            self._own.update(name for name in names if isinstance(name, str))

    def _claim(self, own: Mapping[str, Present]) -> None:
        """Note what more the study will write, before it is written."""
        fresh = {name: present for name, present in own.items() if name not in self._own}
        self._check_free(fresh)
        if fresh:
            self._append([{"own": list(fresh)}])
            self._own.update(fresh)

    def _check_free(self, own: Mapping[str, Present]) -> None:
        there = [found for present in own.values() for found in present()]
        if there:
            more = f", and {len(there) - 1} more" if len(there) > 1 else ""
            raise NotOursError(
                f"{self._folder}: a file {there[0]} is there{more}, and no journal says that this "
                "study wrote it; choose another folder, or move it away"
            )

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Append what ended together and bring it to the disk at once."""
        self.outcomes.update((outcome.key, outcome) for outcome in outcomes)
        self._append([asdict(outcome) for outcome in outcomes])

    def _append(self, lines: Sequence[dict[str, Any]]) -> None:
        try:
            for data in lines:
                self._file.write(_line(data))
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise FileNotWrittenError(
                f"the journal cannot be written: {error.strerror}; what was finished before is kept"
            ) from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(self, *error: object) -> None:
        with suppress(OSError):  # what could not be flushed was reported when it was added
            self._file.close()


def _line(data: dict[str, Any]) -> bytes:
    return json.dumps(data, allow_nan=False).encode() + b"\n"


def _lines(file: BinaryIO) -> Iterator[tuple[bytes, int]]:
    """Give every line and where it begins; of one that is too long a piece longer than allowed."""
    file.seek(0)
    start = 0
    while line := file.readline(LONGEST_LINE + 1):
        begun, piece = start, line
        start += len(line)
        while len(piece) > LONGEST_LINE and not piece.endswith(b"\n"):
            piece = file.readline(LONGEST_LINE + 1)
            start += len(piece)
        yield line, begun


def _parsed(line: bytes) -> dict[str, Any] | None:
    """Return the object that a line holds, None where it holds none."""
    try:
        data = json.loads(line) if line.endswith(b"\n") else None
    except (ValueError, RecursionError):
        return None
    return data if isinstance(data, dict) else None


def _lock(file: BinaryIO, folder: Path) -> None:
    """Keep a second process out for as long as the file is open."""
    try:
        import fcntl
    except ImportError:  # no such lock on this system
        return
    try:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError as error:
        raise JournalInUseError(f"another process works on the study in {folder}") from error
