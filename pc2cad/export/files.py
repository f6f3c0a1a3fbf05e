"""Write a file whole or not at all.

The bytes go to a temporary file beside the target, reach the disk, and take the target's name in
one step; until then the old file stays as it was.
"""

from __future__ import annotations

import errno
import os
import secrets
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import TypeVar

from pc2cad.errors import FileNotWrittenError, InputError

Entry = TypeVar("Entry")

#: Start of the names of temporary files, so that left-overs of a killed process can be found.
TEMPORARY_PREFIX = ".pc2cad-"

_ADVICE = {
    errno.ENOENT: "its folder does not exist; create the folder first",
    errno.ENOTDIR: "a part of its folder's path is a file; choose another folder",
    errno.EACCES: "there is no permission to write there; choose another folder or file",
    errno.EPERM: "there is no permission to write there; choose another folder or file",
    errno.EROFS: "the file system is read-only; choose another folder",
    errno.ENOSPC: "the disk is full; free some space and write again",
    errno.EDQUOT: "the disk quota is used up; free some space and write again",
    errno.EFBIG: "the file would exceed the size limit set for this process; raise the limit",
    errno.ENAMETOOLONG: "the name is too long; choose a shorter one",
    errno.ELOOP: "its symbolic links form a loop; choose another name",
    errno.EMFILE: "too many files are open; close some and write again",
    errno.ENFILE: "too many files are open; close some and write again",
    errno.EISDIR: "a folder has that name; choose another name",
}


def by_ending(path: str | os.PathLike[str], table: Mapping[str, Entry], kind: str) -> Entry:
    """Return what a table of endings (``.step`` …) holds for a file's name, in any case.

    `kind` says for the message what is to be written, as in "mesh file". Raises InputError.
    """
    ending = Path(path).suffix.lower()
    if ending not in table:
        has = f"the ending {ending!r}" if ending else "no ending"
        raise InputError(
            f"The {kind} {os.fspath(path)[-80:]!r} has {has}; use one of {', '.join(table)}."
        )
    return table[ending]


def check_target(path: str | os.PathLike[str]) -> None:
    """Find out before an expensive computation whether `path` can be written.

    Raises:
        FileNotWrittenError: the name is not valid, its folder is missing or not writable, or
            something that is no regular file has that name.

    """
    target = _resolve(path)
    _mode_of_existing(path, target)
    try:
        descriptor, probe = _create_beside(target, 0o600)
        os.close(descriptor)
        os.unlink(probe)
    except OSError as error:
        raise _failure(path, error) from error


def write_atomically(path: str | os.PathLike[str], data: bytes) -> None:
    """Write `data` to `path` in one step: see `replacing`."""
    with replacing(path) as temporary, open(temporary, "wb") as stream:
        stream.write(data)


@contextmanager
def replacing(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Give the name of an empty file to fill, which then takes the place of `path` in one step.

    Afterwards there is the whole new file or, after any error inside, the old one. A symbolic link
    stays and the file that it points to is replaced. A replaced file keeps its permissions, a new
    one gets the usual permissions of the process.

    Raises:
        FileNotWrittenError: it could not be written; the old file is untouched and no temporary
            file is left.

    """
    target = _resolve(path)
    mode = _mode_of_existing(path, target)
    try:
        descriptor, temporary = _create_beside(target, 0o666 if mode is None else mode)
        try:
            try:
                if mode is not None:
                    os.fchmod(descriptor, mode)
                yield Path(temporary)
                os.fsync(descriptor)
            finally:
                os.close(descriptor)
            os.replace(temporary, target)
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise
    except OSError as error:
        raise _failure(path, error) from error
    _sync_folder(target.parent)


def sweep(folder: Path, process: int | None = None) -> None:
    """Remove temporary files that a killed process has left; without it nobody may write there."""
    whose = "" if process is None else f"{process}-"
    for path in folder.glob(f"{TEMPORARY_PREFIX}{whose}*.tmp"):
        with suppress(OSError):
            path.unlink()


def _resolve(path: str | os.PathLike[str]) -> Path:
    """Return the real file behind `path`, links followed."""
    text = os.fspath(path)
    if not text:
        raise FileNotWrittenError("Cannot write the file: its name is empty; give a file name.")
    if "\0" in text:
        raise FileNotWrittenError(
            f"Cannot write {text!r}: a file name must not contain a NUL character."
        )
    try:
        return Path(os.path.realpath(text))
    except UnicodeError:
        raise FileNotWrittenError(
            f"Cannot write {text!r}: the name has characters that this system cannot store in "
            "file names; choose another name."
        ) from None
    except OSError as error:
        raise _failure(path, error) from error


def _mode_of_existing(path: str | os.PathLike[str], target: Path) -> int | None:
    """Return the permission bits of an existing writable regular file, None for a new file."""
    try:
        status = os.stat(target)
    except FileNotFoundError:
        return None
    except OSError as error:
        raise _failure(path, error) from error
    if stat.S_ISDIR(status.st_mode):
        raise FileNotWrittenError(
            f"Cannot write {_shown(path)}: a folder has that name; choose another name."
        )
    if not stat.S_ISREG(status.st_mode):
        raise FileNotWrittenError(
            f"Cannot write {_shown(path)}: it is a device or a pipe, not a file; choose another "
            "name."
        )
    if not os.access(target, os.W_OK):
        raise FileNotWrittenError(
            f"Cannot write {_shown(path)}: the existing file is write-protected; remove it or "
            "choose another name."
        )
    return stat.S_IMODE(status.st_mode)


def _create_beside(target: Path, mode: int) -> tuple[int, str]:
    """Create an empty temporary file in the target's folder; the system applies the umask."""
    # as in tempfile, but with the permissions of an ordinary new file instead of 0600
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0)
    for _ in range(100):
        name = str(target.parent / f"{TEMPORARY_PREFIX}{os.getpid()}-{secrets.token_hex(8)}.tmp")
        with suppress(FileExistsError):
            return os.open(name, flags, mode), name
    raise FileExistsError(errno.EEXIST, "no free name for a temporary file", str(target.parent))


def _sync_folder(folder: Path) -> None:
    """Bring the new name to the disk; the file is complete already, so failing is no failure."""
    with suppress(OSError):
        descriptor = os.open(folder, os.O_RDONLY)
        try:
            os.fsync(descriptor)
        finally:
            os.close(descriptor)


def _failure(path: str | os.PathLike[str], error: OSError) -> FileNotWrittenError:
    reason = _ADVICE.get(error.errno or 0)
    if reason is None:
        said = error.strerror or str(error)
        reason = f"the system says {said!r}; choose another place"
    return FileNotWrittenError(f"Cannot write {_shown(path)}: {reason}.")


def _shown(path: str | os.PathLike[str]) -> str:
    """Path for a message: quoted where it has odd characters, cut where it is very long."""
    text = os.fspath(path)
    if len(text) > 200:
        text = f"{text[:100]}…{text[-60:]}"
    return text if text.isprintable() else repr(text)
