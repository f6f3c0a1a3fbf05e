"""Where the files of a study go: a folder, or an address that fsspec knows (s3://…, memory://)."""

from __future__ import annotations

import hashlib
import os
from collections.abc import Iterator
from functools import lru_cache
from itertools import count
from pathlib import Path
from typing import Any, Protocol

from pc2cad.errors import FileNotWrittenError, InputError
from pc2cad.export.files import sweep, write_atomically
from pc2cad.trust.names import check_file_name


class Store(Protocol):
    """A place for files with plain names; a file is there whole or not at all."""

    def write(self, name: str, data: bytes) -> None:
        """Write a file; raise FileNotWrittenError."""

    def read(self, name: str) -> bytes:
        """Return what a file holds; raise OSError."""

    def names(self) -> set[str]:
        """Return the names of all files; raise FileNotWrittenError where none can be."""

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file, None where none is there, '' where it cannot be read."""

    def set_aside(self, name: str) -> str:
        """Give a file another name, and return it; raise FileNotWrittenError."""

    def sweep(self) -> None:
        """Remove what a killed process has left half written."""


class FolderStore:
    """A folder of this machine, or one that all machines share."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, name: str, data: bytes) -> None:
        """Write a file in one step."""
        try:
            if not os.path.isdir(self._folder):
                self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileNotWrittenError(
                f"the folder {self._folder} cannot be made: {error.strerror}"
            ) from error
        write_atomically(self._folder / check_file_name(name), data, owned=True)

    def read(self, name: str) -> bytes:
        """Return what a file holds."""
        return (self._folder / check_file_name(name)).read_bytes()

    def names(self) -> set[str]:
        """Return the names of all files."""
        try:
            return set(os.listdir(self._folder))
        except FileNotFoundError:
            return set()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or str(error)
            raise FileNotWrittenError(
                f"the folder {self._folder} cannot be used: {reason}"
            ) from error

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file; what is no file is not opened."""
        path = self._folder / check_file_name(name)
        try:
            if not path.is_file():
                return "" if os.path.lexists(path) else None
            with open(path, "rb") as stream:
                return hashlib.file_digest(stream, "sha256").hexdigest()
        except OSError:
            return ""

    def set_aside(self, name: str) -> str:
        """Give a file another name."""
        path = self._folder / check_file_name(name)
        try:
            for other in _others(name):
                if not os.path.lexists(self._folder / other):
                    os.rename(path, self._folder / other)
                    return other
        except OSError as error:
            raise FileNotWrittenError(
                f"{path} is not as it was written and cannot be renamed: {error.strerror}"
            ) from error
        raise AssertionError(name)

    def sweep(self) -> None:
        """Remove temporary files of killed processes."""
        sweep(self._folder)


class AddressStore:
    """A place that fsspec reaches; object stores put a file in one step."""

    def __init__(self, address: str) -> None:
        try:
            import fsspec
        except ImportError as error:
            raise InputError(
                f"the address {address[:80]} needs fsspec: pip install 'pc2cad[study]'"
            ) from error
        try:
            self._system: Any
            self._system, self._root = fsspec.core.url_to_fs(address)
        except (ValueError, ImportError, OSError) as error:
            raise InputError(f"the address {address[:80]} cannot be used: {error}") from error

    def write(self, name: str, data: bytes) -> None:
        """Put a file."""
        try:
            self._system.makedirs(self._root, exist_ok=True)
            self._system.pipe_file(self._at(name), data)
        except OSError as error:
            raise FileNotWrittenError(f"cannot write {name}: {error}") from error

    def read(self, name: str) -> bytes:
        """Return what a file holds."""
        return bytes(self._system.cat_file(self._at(name)))

    def names(self) -> set[str]:
        """Return the names of all files."""
        try:
            found = self._system.ls(self._root, detail=False)
        except FileNotFoundError:
            return set()
        except OSError as error:
            raise FileNotWrittenError(f"{self._root} cannot be used: {error}") from error
        return {str(path).rstrip("/").rpartition("/")[2] for path in found}

    def digest(self, name: str) -> str | None:
        """Return the SHA-256 of a file."""
        try:
            return hashlib.sha256(self.read(name)).hexdigest()
        except FileNotFoundError:
            return None
        except OSError:
            return ""

    def set_aside(self, name: str) -> str:
        """Give a file another name."""
        other = next(other for other in _others(name) if not self._system.exists(self._at(other)))
        try:
            self._system.mv(self._at(name), self._at(other))
        except OSError as error:
            raise FileNotWrittenError(
                f"{name} is not as it was written and cannot be renamed: {error}"
            ) from error
        return other

    def _at(self, name: str) -> str:
        return f"{self._root.rstrip('/')}/{check_file_name(name)}"

    def sweep(self) -> None:
        """Do nothing: a file is there when it is whole."""


def _others(name: str) -> Iterator[str]:
    """Give names for a file that is set aside."""
    yield f"{name}.changed"
    yield from (f"{name}.changed-{number}" for number in count(2))


@lru_cache(maxsize=4)
def open_store(place: str) -> Store:
    """Return the store of a folder's path or of an address with a scheme."""
    if "://" in place:
        return AddressStore(place)
    return FolderStore(Path(os.path.abspath(place)))
