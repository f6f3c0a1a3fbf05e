"""Materials that vary over a solid, as solvers have them: a section for each bin of values."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.errors import InputError
from pc2cad.mesh.volume_mesh import VolumeMesh


@dataclass(frozen=True, eq=False)
class Bin:
    """Elements of nearly one material: their numbers from 1 on, and the means of its properties."""

    elements: Integers
    values: Mapping[str, float]


def scalar_column(mesh: VolumeMesh, name: str) -> None:
    """Raise InputError unless the mesh has a scalar field (or u, v, w) of this name."""
    sizes = {} if mesh.columns is None else mesh.columns.sizes
    if name not in sizes:
        known = ", ".join(sizes) or "none"
        raise InputError(f"no field is called '{name[:40]}': there are {known}")
    if sizes[name] != 1:
        raise InputError(f"the field {name} is no scalar")


def at_nodes(mesh: VolumeMesh, name: str) -> Array:
    """Return a scalar field at the nodes, (nodes,); raise InputError where there is none."""
    scalar_column(mesh, name)
    assert mesh.columns is not None
    return mesh.columns.at_nodes(name)[:, 0]


def bins_of(
    mesh: VolumeMesh, layers: Sequence[str], fields: Mapping[str, str], count: int
) -> Iterator[Bin]:
    """Give the elements of some layers (of none: of the whole mesh) by bins of their properties.

    `fields` names the scalar field that each property is. The values of each, within the elements,
    are parted into `count` bins of equal width. Raises InputError for names of no scalar field.
    """
    for field in fields.values():
        scalar_column(mesh, field)
    assert mesh.columns is not None
    numbers: list[Integers] = []
    rows: list[Array] = []
    for kind, block in mesh.blocks.items():
        own = np.arange(len(block))
        if layers:
            parts = [mesh.layers[name].get(kind, own[:0]) for name in layers]
            own = np.sort(np.concatenate(parts))
        columns = [mesh.columns.in_elements(field, kind)[own, 0] for field in fields.values()]
        numbers.append(own + mesh.first_element(kind) + 1)
        rows.append(np.stack(columns, axis=1))
    elements, values = np.concatenate(numbers), np.concatenate(rows)
    low, span = values.min(axis=0), np.ptp(values, axis=0)
    share = (values - low) / np.where(span > 0, span, 1.0)
    which = np.minimum((share * count).astype(np.int64), count - 1)
    kinds, of_kind = np.unique(which, axis=0, return_inverse=True)
    for k in range(len(kinds)):
        here = of_kind.ravel() == k
        means = values[here].mean(axis=0).tolist()
        yield Bin(elements[here], dict(zip(fields, means, strict=True)))
