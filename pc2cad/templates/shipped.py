"""The shipped templates: where they are, and finding one by name."""

from __future__ import annotations

from collections.abc import Callable
from functools import lru_cache
from pathlib import Path

from pc2cad.errors import InputError


class UnknownTemplateError(InputError):
    """Neither a file nor a shipped template has the given name."""


def template_folder() -> Path:
    """Return the folder of the shipped templates: in the package, or in the checkout around it."""
    package = Path(__file__).resolve().parent.parent
    checkout = package.parent
    if (checkout / "pyproject.toml").is_file() and (checkout / "templates").is_dir():
        return checkout / "templates"
    return package / "templates" / "library"


def template_paths() -> dict[str, Path]:
    """Return the shipped templates of one equation, name -> file, in the order of their names."""
    return _templates(template_folder())


def bodies_paths() -> dict[str, Path]:
    """Return the shipped templates of several bodies, as `template_paths` does."""
    return _templates(template_folder() / "bodies")


def _templates(folder: Path) -> dict[str, Path]:
    return dict(_listed(folder, folder.stat().st_mtime_ns)) if folder.is_dir() else {}


@lru_cache(maxsize=4)  # a folder's time is that of its last new or lost file
def _listed(folder: Path, _: int) -> tuple[tuple[str, Path], ...]:
    return tuple([(path.stem, path) for path in sorted(folder.glob("*.toml"))])


def find_template(file_or_name: str) -> Path:
    """Return the file that a user means: an existing file, or else a shipped template by its name.

    Raises:
        UnknownTemplateError: there is neither; the message offers the nearest names.

    """
    path = Path(file_or_name)
    if _exists(path, Path.is_file):
        return path
    shipped = template_paths() | bodies_paths()
    if file_or_name in shipped:
        return shipped[file_or_name]
    if file_or_name and _exists(path, Path.exists):
        return path  # a folder or a device: reading it says what it is
    from pc2cad.equation.language import nearest

    stem = path.name.removesuffix(".toml")
    shown = file_or_name if len(file_or_name) <= 200 else f"{file_or_name[:200]}…"
    raise UnknownTemplateError(
        f"there is no file and no shipped template '{shown}' ('pc2cad templates' lists those)"
        f"{nearest(stem, shipped)}"
    )


def _exists(path: Path, test: Callable[[Path], bool]) -> bool:
    try:
        return test(path)
    except (OSError, ValueError):  # a name that no file can have
        return False
