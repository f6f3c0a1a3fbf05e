"""The journal of a study: one line per finished variant, on the disk before it is counted.

The journal is the truth; the results table is made from it. A process that dies leaves at most one
torn line at the end, which is cut off when the study is resumed.
"""

from __future__ import annotations

import json
import os
import stat
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict
from pathlib import Path
from types import TracebackType
from typing import Any, BinaryIO

from pc2cad.errors import FileNotWrittenError, InputError
from pc2cad.studies.variant import Outcome

NAME = "journal.jsonl"
#: bytes of one line
LONGEST_LINE = 1024 * 1024


class JournalInUseError(InputError):
    """Another process works on the same study."""


class StudyDiffersError(InputError):
    """The folder holds another study, or one that was not asked to go on."""


class Journal:
    """An open journal: the outcomes it holds, and a way to add one.

    Raises JournalInUseError, StudyDiffersError or FileNotWrittenError when it is opened.
    """

    def __init__(self, folder: Path, fingerprint: str, resume: bool) -> None:
        self.outcomes: dict[str, Outcome] = {}
        path = folder / NAME
        try:
            folder.mkdir(parents=True, exist_ok=True)
            self._file: BinaryIO = open(path, "a+b")  # noqa: SIM115  # closed by __exit__
        except OSError as error:
            raise FileNotWrittenError(
                f"the journal {path} cannot be written: {error.strerror}"
            ) from error
        try:
            if not stat.S_ISREG(os.fstat(self._file.fileno()).st_mode):
                raise FileNotWrittenError(f"the journal {path} is a device, not a file")
            _lock(self._file, folder)
            self._begin(fingerprint, resume, folder)
        except BaseException:
            self._file.close()
            raise

    def _begin(self, fingerprint: str, resume: bool, folder: Path) -> None:
        self._file.seek(0)
        lines = _read(self._file)
        header, whole = next(lines, (None, 0))
        if header is None:
            self._file.truncate(0)
            self._append([{"study": fingerprint}])
            return
        if header.get("study") != fingerprint:
            raise StudyDiffersError(
                f"{folder} holds another study: its template, version, formats or options differ; "
                "choose another folder"
            )
        if not resume:
            raise StudyDiffersError(
                f"{folder} holds this study already; go on with it by --resume, or choose another "
                "folder"
            )
        for line, end in lines:
            try:
                outcome = Outcome.from_dict(line)
            except TypeError as error:
                raise StudyDiffersError(
                    f"{folder} holds a journal with a line that is no outcome, at byte {whole}"
                ) from error
            self.outcomes[outcome.key] = outcome
            whole = end
        self._file.truncate(whole)

    def add(self, outcomes: Sequence[Outcome]) -> None:
        """Append what ended together and bring it to the disk at once."""
        self.outcomes.update((outcome.key, outcome) for outcome in outcomes)
        self._append([asdict(outcome) for outcome in outcomes])

    def _append(self, lines: Sequence[dict[str, Any]]) -> None:
        try:
            for data in lines:
                self._file.write(json.dumps(data, allow_nan=False).encode() + b"\n")
            self._file.flush()
            os.fsync(self._file.fileno())
        except OSError as error:
            raise FileNotWrittenError(
                f"the journal cannot be written: {error.strerror}; what was finished before is kept"
            ) from error

    def __enter__(self) -> Journal:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        with suppress(OSError):  # what could not be flushed was reported when it was added
            self._file.close()


def _read(file: BinaryIO) -> Iterator[tuple[dict[str, Any], int]]:
    """Yield what each whole line holds, and where it ends; stop at the first that is torn.

    No line is longer than what one outcome takes: a file without line ends stays unread.
    """
    while (line := file.readline(LONGEST_LINE)).endswith(b"\n"):
        try:
            parsed = json.loads(line)
        except (ValueError, RecursionError):
            return
        if not isinstance(parsed, dict):
            return
        yield parsed, file.tell()


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
