"""Errors of pc2cad, each named after the invariant that was violated.

The exit code of the command line is an attribute of the class, so that a script can tell a typing
mistake (2) from a map that is no solid (3), a tolerance that was not reached (4) and trouble with
the kernel or a file (5).
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from importlib.util import find_spec


class PointCadError(Exception):
    """Base of everything that pc2cad raises on purpose; its text is one clear sentence."""

    exit_code = 5


class InputError(PointCadError):
    """The input (expression, template, parameter value, option) is not well formed."""

    exit_code = 2


class PackageMissingError(InputError):
    """What was asked for needs a package that is not installed."""


class NotASolidError(PointCadError):
    """The point equation is well formed, but its image is not one valid solid."""

    exit_code = 3


class ToleranceNotReachedError(PointCadError):
    """The carriers could not be brought within the requested tolerance of the equation."""

    exit_code = 4


class KernelError(PointCadError):
    """The CAD kernel refused an operation or delivered a result that fails its checks."""

    exit_code = 5


class FileNotWrittenError(PointCadError):
    """A file could not be written; nothing of it is left behind."""

    exit_code = 5


def require(package: str, what: str, brought_by: str = "'pc2cad[fea]'") -> None:
    """Raise PackageMissingError where a package is not installed; pip installs `brought_by`."""
    if find_spec(package) is None:
        raise PackageMissingError(
            f"{what} need the package {package}, which is not installed: pip install {brought_by}"
        )


@contextmanager
def named(subject: str) -> Iterator[None]:
    """Put a subject (a file, an option, a body) before the message of an error, if it lacks it."""
    try:
        yield
    except PointCadError as error:
        if not str(error).startswith((f"{subject}:", f"{subject} ")):
            error.args = (f"{subject}: {error}",)
        raise
