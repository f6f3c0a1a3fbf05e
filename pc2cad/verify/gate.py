"""What is written is verified first: the gate of ``build --verify`` and of studies."""

from __future__ import annotations

from typing import Any

from pc2cad.equation.point_equation import PointEquation
from pc2cad.templates.bodies import Bodies
from pc2cad.verify.against import verification
from pc2cad.verify.defects import StepDefectError
from pc2cad.verify.receipt import parse_step


class NotThisSolidError(StepDefectError):
    """A STEP file is not the solid of its equation."""


def require_verified(
    data: bytes, equation: PointEquation | Bodies, tolerance: float
) -> dict[str, Any]:
    """Return the verdict on the bytes of a STEP file, for a report.

    Raises:
        NotThisSolidError: something differs from the equations by more than the tolerance.
        StepUnreadableError: the bytes are no STEP file.

    """
    file = parse_step(data)
    found = verification(file, equation, tolerance)
    if not found.verified:
        raise NotThisSolidError(f"the STEP file is not this solid: {found.differences[0]}")
    told = found.to_dict()
    kept = ("verified", "tolerance", "deviation", "evidence", "faces")
    return {"sha256": file.sha256, "sound": True} | {key: told[key] for key in kept}
