"""What was verified, as plain data that `replay` re-checks by arithmetic alone."""

from __future__ import annotations

import hashlib
import os
from math import isfinite
from pathlib import Path
from typing import Any

import pc2cad
from pc2cad.errors import InputError
from pc2cad.verify.replay import FORMAT
from pc2cad.verify.sides import Match
from pc2cad.verify.verdict import Verification


class NotVerifiedError(InputError):
    """There is no certificate of a file that is not verified."""


def certificate(
    found: Verification,
    file: str | os.PathLike[str],
    template: str | os.PathLike[str] | None = None,
) -> dict[str, Any]:
    """Return the certificate of a verification that was made with ``claims``.

    `file` gives its name; the hash is that of the bytes that were read. `template` is the file of
    the template, None where the equation is from a script.

    Raises:
        NotVerifiedError: something differs.

    """
    if not found.verified:
        raise NotVerifiedError(f"no certificate: {found.differences[0]}")
    equation, receipt = found.equation, found.file
    source = None if template is None else Path(template)
    return {
        "format": FORMAT,
        "version": pc2cad.__version__,
        "verified": True,
        "file": {"name": Path(file).name, "sha256": receipt.sha256},
        "template": source
        and {
            "name": source.name,
            "sha256": hashlib.sha256(source.read_bytes()).hexdigest(),
        },
        "parameters": {name: float(value) for name, value in equation.parameters.items()},
        "units": found.units,
        "tolerance": found.tolerance,
        "faces": [_face(match) for match in found.matches],
        "edges": {"closed": "exact", "count": sum(solid.edges for solid in receipt.solids)},
        "integrals": _integrals(found),
    }


def _face(match: Match) -> dict[str, Any]:
    return {
        "face": int(match.face.face.ref),
        "side": match.name,
        "carrier": match.face.face.carrier,
        "rests_on": match.nearness.rests_on,
        "distance": match.reach,
        "border": {"distance": match.border_reach, "rests_on": match.edges.rests_on},
        "replay": list(match.nearness.claims),
    }


def _integrals(found: Verification) -> dict[str, Any]:
    solids, mass = found.file.solids, found.mass
    bounds = {
        "volume_bound": sum(solid.volume_bound for solid in solids),
        "area_bound": sum(solid.area_bound for solid in solids),
    }
    return {
        "file": {
            "volume": sum(solid.volume or 0.0 for solid in solids),
            "area": sum(solid.area or 0.0 for solid in solids),
            **{name: bound if isfinite(bound) else None for name, bound in bounds.items()},
        },
        "equation": {
            "volume": mass.volume, "area": mass.area, "relative_error": mass.relative_error,
            "source": mass.source,
        },
    }  # fmt: skip
