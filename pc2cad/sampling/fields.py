"""Values of fields at places of a solid, given by points in space or by parameters."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from pc2cad.arrays import Array
from pc2cad.checked import CheckedMap
from pc2cad.domain.fields import local_field
from pc2cad.errors import InputError
from pc2cad.sampling.interior import locate


def field_values(
    checked: CheckedMap, name: str, points: ArrayLike | None, parameters: ArrayLike | None
) -> Array:
    """Return a field's values, (n,) of a scalar, else (n, 3), at points or at u, v, w (n, 3).

    For a point outside the solid it is the value at the nearest place. Raises InputError for a
    name of no field, or parameters outside the box; FieldNotFiniteError.
    """
    if (points is None) == (parameters is None):
        raise InputError("give the points of a field's values, or their parameters")
    field = local_field(checked.analysis, name)
    if points is not None:
        own = locate(checked, points).parameters
    else:
        own = np.atleast_2d(np.asarray(parameters, dtype=float))
        if own.ndim != 2 or own.shape[1] != 3 or not np.isfinite(own).all():
            raise InputError("parameters are rows of three finite numbers: u, v and w")
        for d, (low, high) in enumerate(checked.equation.limits):
            room = 1e-12 * max(abs(low), abs(high))
            if (own[:, d] < low - room).any() or (own[:, d] > high + room).any():
                raise InputError(f"{'uvw'[d]} runs from {low:g} to {high:g} here")
    local = [checked.map.local(d, own[:, d]) for d in range(3)]
    values = field.checked_at(np.clip(np.stack(local, axis=1), 0.0, 1.0))
    return values[:, 0] if field.field.kind == "scalar" else values
