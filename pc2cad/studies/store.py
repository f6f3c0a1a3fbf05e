"""Where the files of a study go: a folder, or an address that fsspec knows (s3://…, memory://)."""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import Any, Protocol

from pc2cad.errors import FileNotWrittenError, InputError
from pc2cad.export.files import sweep, write_atomically


class Store(Protocol):
    """A place for files with plain names; a file is there whole or not at all."""

    def write(self, name: str, data: bytes) -> None:
        """Write a file; raise FileNotWrittenError."""

    def read(self, name: str) -> bytes:
        """Return what a file holds; raise OSError."""

    def has(self, name: str) -> bool:
        """Say whether a file is there."""

    def sweep(self) -> None:
        """Remove what a killed process has left half written."""


class FolderStore:
    """A folder of this machine, or one that all machines share."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def write(self, name: str, data: bytes) -> None:
        """Write a file in one step."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
        except OSError as error:
            raise FileNotWrittenError(
                f"the folder {self._folder} cannot be made: {error.strerror}"
            ) from error
        write_atomically(self._folder / name, data)

    def read(self, name: str) -> bytes:
        """Return what a file holds."""
        return (self._folder / name).read_bytes()

    def has(self, name: str) -> bool:
        """Say whether a file is there."""
        return (self._folder / name).is_file()

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
            self._system.pipe_file(f"{self._root.rstrip('/')}/{name}", data)
        except OSError as error:
            raise FileNotWrittenError(f"cannot write {name}: {error}") from error

    def read(self, name: str) -> bytes:
        """Return what a file holds."""
        return bytes(self._system.cat_file(f"{self._root.rstrip('/')}/{name}"))

    def has(self, name: str) -> bool:
        """Say whether a file is there."""
        return bool(self._system.exists(f"{self._root.rstrip('/')}/{name}"))

    def sweep(self) -> None:
        """Do nothing: a file is there when it is whole."""


@lru_cache(maxsize=4)
def open_store(place: str) -> Store:
    """Return the store of a folder's path or of an address with a scheme."""
    if "://" in place:
        return AddressStore(place)
    return FolderStore(Path(os.path.abspath(place)))
