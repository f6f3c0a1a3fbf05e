"""What can be wrong with a STEP file."""

from __future__ import annotations

from pc2cad.errors import InputError, PointCadError


class StepUnreadableError(InputError):
    """The text is no exchange structure of ISO 10303-21, or larger than what is read."""


class StepDefectError(PointCadError):
    """The file contradicts itself; the sentence says where."""

    exit_code = 6


class StepUnknownError(StepDefectError):
    """The file may be sound, but uses a form that is not known here: it is named, not guessed."""


class StepOrientationError(StepDefectError):
    """A face, a loop or a shell is turned over."""
