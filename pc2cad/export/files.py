"""Write a file whole or not at all.

The bytes go to a temporary file beside the target, reach the disk, and take the target's name in
one step; until then the old file stays as it was. A process that is killed leaves its temporary
file, which the next one that writes into the folder removes: its name says whose it is, and a lock
on it that its owner lives, on this machine or another.
"""

from __future__ import annotations

import errno
import os
import re
import stat
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache
from pathlib import Path
from typing import TypeVar

from pc2cad.errors import FileNotWrittenError, InputError
from pc2cad.trust.names import visible
from pc2cad.trust.processes import start_of

try:
    import fcntl
except ImportError:  # no such locks on this system, and left-overs stay there
    fcntl = None  # type: ignore[assignment]

Entry = TypeVar("Entry")

#: Start of the names of temporary files, so that left-overs of a killed process can be found.
TEMPORARY_PREFIX = ".pc2cad-"
#: process and its start, where the system tells it
_TEMPORARY = re.compile(r"\.pc2cad-([0-9]{1,10})-(?:([0-9]{1,20})-)?[0-9a-f]{16}\.tmp")

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
    errno.EEXIST: "a file has that name already; choose another one",
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
            f"the {kind} {os.fspath(path)[-80:]!r} has {has}; use one of {', '.join(table)}"
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


def write_atomically(
    path: str | os.PathLike[str],
    data: bytes | Callable[[], bytes],
    *,
    owned: bool = False,
    new: bool = False,
) -> None:
    """Write `data`, or what it returns, to `path` in one step: see `replacing`.

    It is called when it is known that the file can be written.
    """
    with _replacing(path, owned, new) as (descriptor, _):
        rest = memoryview(data() if callable(data) else data)
        while rest:
            rest = rest[os.write(descriptor, rest) :]


@contextmanager
def replacing(
    path: str | os.PathLike[str], *, owned: bool = False, new: bool = False
) -> Iterator[Path]:
    """Give the name of an empty file to fill, which then takes the place of `path` in one step.

    Afterwards there is the whole new file or, after any error inside, the old one. A symbolic link
    stays and the file that it points to is replaced. A replaced file keeps its permissions, a new
    one gets the usual permissions of the process. Left-overs of killed processes beside it go.

    Args:
        path: the file's name.
        owned: the name is not a user's choice but that of a file in a folder of ours, where a
            link that somebody has put must not lead the bytes elsewhere; whoever writes many files
            there sweeps the folder himself.
        new: nothing may have that name yet.

    Raises:
        FileNotWrittenError: it could not be written; the old file is untouched and no temporary
            file is left.

    """
    with _replacing(path, owned, new) as (_, temporary):
        yield Path(temporary)


@contextmanager
def _replacing(path: str | os.PathLike[str], owned: bool, new: bool) -> Iterator[tuple[int, str]]:
    """Give the open file that `replacing` gives the name of, and its name."""
    target = _unlinked(path) if owned or new else _resolve(path)
    mode = None if new else _mode_of_existing(path, target)
    if not owned:
        sweep(target.parent)
    try:
        descriptor, temporary = _create_beside(target, 0o666 if mode is None else mode)
        try:
            try:
                if mode is not None:
                    os.fchmod(descriptor, mode)
                yield descriptor, temporary
                os.fsync(descriptor)
                if fcntl is not None:  # under its lock; elsewhere an open file cannot be moved
                    _move(temporary, target, new)
            finally:
                os.close(descriptor)
            if fcntl is None:
                _move(temporary, target, new)
        except BaseException:
            with suppress(OSError):
                os.unlink(temporary)
            raise
    except OSError as error:
        raise _failure(path, error) from error
    _sync_folder(target.parent)


def sweep(folder: Path) -> None:
    """Remove the temporary files of dead processes from a folder; what is not ours stays."""
    if fcntl is None:
        return
    with suppress(OSError), os.scandir(folder) as entries:
        for entry in entries:
            found = _TEMPORARY.fullmatch(entry.name)
            if found is None or not _is_dead(int(found[1]), found[2]):
                continue
            with suppress(OSError):
                _remove_unlocked(entry.path)


def sweep_after(folder: Path, process: int) -> None:
    """Remove the temporary files of a child process that has just ended."""
    for path in folder.glob(f"{TEMPORARY_PREFIX}{process}-*.tmp"):
        with suppress(OSError):
            path.unlink()


def _is_dead(process: int, start: str | None) -> bool:
    found = start_of(process)
    return found is None or (bool(start) and found not in ("", start))


def _remove_unlocked(path: str) -> None:
    """Remove a regular file of this user that nobody holds a lock on."""
    descriptor = os.open(path, os.O_RDWR | os.O_NOFOLLOW | os.O_NONBLOCK | os.O_CLOEXEC)
    try:
        status = os.fstat(descriptor)
        if stat.S_ISREG(status.st_mode) and status.st_uid == os.geteuid():
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
            os.unlink(path)
    finally:
        os.close(descriptor)


def _move(temporary: str, target: Path, new: bool) -> None:
    if not new:
        os.replace(temporary, target)
        return
    try:
        os.link(temporary, target)
    except FileExistsError:
        raise
    except OSError:  # a file system without links
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, "there is one", str(target)) from None
        os.replace(temporary, target)
    else:
        os.unlink(temporary)


def _unlinked(path: str | os.PathLike[str]) -> Path:
    """Return the file behind `path` where only its folder is reached by links."""
    resolved = _resolve(path)  # says what is wrong with a name that cannot be
    if os.path.islink(path):
        raise FileNotWrittenError(
            f"cannot write {_shown(path)}: a symbolic link has that name, which is neither "
            "followed nor replaced; remove it"
        )
    return resolved


def _resolve(path: str | os.PathLike[str]) -> Path:
    """Return the real file behind `path`, links followed."""
    text = os.fspath(path)
    if not text:
        raise FileNotWrittenError("cannot write the file: its name is empty; give a file name")
    if "\0" in text:
        raise FileNotWrittenError(
            f"cannot write {text!r}: a file name must not contain a NUL character"
        )
    try:
        return Path(os.path.realpath(text))
    except UnicodeError:
        raise FileNotWrittenError(
            f"cannot write {text!r}: the name has characters that this system cannot store in "
            "file names; choose another name"
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
            f"cannot write {_shown(path)}: a folder has that name; choose another name"
        )
    if not stat.S_ISREG(status.st_mode):
        raise FileNotWrittenError(
            f"cannot write {_shown(path)}: it is a device or a pipe, not a file; choose another "
            "name"
        )
    if not os.access(target, os.W_OK):
        raise FileNotWrittenError(
            f"cannot write {_shown(path)}: the existing file is write-protected; remove it or "
            "choose another name"
        )
    return stat.S_IMODE(status.st_mode)


def _create_beside(target: Path, mode: int) -> tuple[int, str]:
    """Create an empty temporary file in the target's folder; the system applies the umask."""
    # as in tempfile, but with the permissions of an ordinary new file instead of 0600
    flags = os.O_RDWR | os.O_CREAT | os.O_EXCL | getattr(os, "O_CLOEXEC", 0)
    own = _process(os.getpid())
    for _ in range(100):
        name = str(target.parent / f"{TEMPORARY_PREFIX}{own}-{os.urandom(8).hex()}.tmp")
        with suppress(FileExistsError):
            descriptor = os.open(name, flags, mode)
            if _locked(descriptor):
                return descriptor, name
            os.close(descriptor)
    raise FileExistsError(errno.EEXIST, "no free name for a temporary file", str(target.parent))


@lru_cache(maxsize=1)
def _process(number: int) -> str:
    """Return what tells this process from others, earlier and later ones."""
    return "-".join(filter(None, (str(number), start_of(number))))


def _locked(descriptor: int) -> bool:
    """Lock a temporary file; say whether it is still there: somebody may have swept it before."""
    if fcntl is None:
        return True
    with suppress(OSError):  # a file system without locks
        fcntl.flock(descriptor, fcntl.LOCK_EX)
    return os.fstat(descriptor).st_nlink > 0


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
    return FileNotWrittenError(f"cannot write {_shown(path)}: {reason}")


def _shown(path: str | os.PathLike[str]) -> str:
    """Path for a message: quoted where it has odd characters, cut where it is very long."""
    text = os.fspath(path)
    if len(text) > 200:
        text = f"{text[:100]}…{text[-60:]}"
    return text if text.isprintable() else f"'{visible(text)}'"
