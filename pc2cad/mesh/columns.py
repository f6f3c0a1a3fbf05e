"""What the nodes and elements of a mesh hold beside their places: u, v, w, and fields."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from pc2cad.arrays import Array
from pc2cad.checked import CheckedMap
from pc2cad.domain.fields import local_field
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.evaluation import Program
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.mesh.places import Places
from pc2cad.mesh.volume_mesh import VolumeMesh

#: the direction of a channel's guide, where no field has this name
GUIDE = "guide"


@dataclass(frozen=True, eq=False)
class Columns:
    """The equation's own u, v and w, and its fields, worked out when they are asked for."""

    checked: CheckedMap
    mesh: VolumeMesh
    places: Places

    @cached_property
    def sizes(self) -> Mapping[str, int]:
        """The names of all columns, and how many components each has."""
        fields = {field.name: len(field.components) for field in self.checked.equation.fields}
        return {**dict.fromkeys(PARAMETERS, 1), **fields}

    def at_nodes(self, name: str) -> Array:
        """Return a column at the nodes, (nodes, components); raise FieldNotFiniteError."""
        return self._values(name, self._nodes, self.mesh.points)

    def in_elements(self, name: str, kind: str) -> Array:
        """Return a column within each element of a type, (elements, components)."""
        return self._values(name, self._elements(kind))

    def in_facets(self, name: str, side: str) -> dict[str, Array]:
        """Return a column within each facet of a side, by shape as `facet_nodes`."""
        places = self._facets(side)
        return {shape: self._values(name, rows) for shape, rows in places.items()}

    @cached_property
    def directions(self) -> tuple[str, ...]:
        """What `directed` knows: ways of u, v and w, of the guide, and vectors."""
        vectors = [f.name for f in self.checked.equation.fields if f.kind == "vector"]
        guide = [GUIDE] if self.checked.equation.guide is not None and GUIDE not in vectors else []
        return (*PARAMETERS, *guide, *vectors)

    def directed(self, name: str, kind: str) -> Array:
        """Return a direction within each element of a type, (elements, 3), of any length.

        Of u, v and w it is that of ∂M/∂u, …; of the guide, of N'(u).
        """
        local = self._elements(kind)
        if name in PARAMETERS:
            return self.checked.map.tangents((PARAMETERS.index(name),), *local.T)[0]
        guide = self.checked.equation.guide
        if name != GUIDE or guide is None or name in self.sizes:
            return self._values(name, local)
        own = self.checked.map.values(0, local[:, 0])
        along = Program(derivatives(guide, PARAMETERS[0]))({PARAMETERS[0]: own})
        return np.stack([np.broadcast_to(row, own.shape) for row in along], axis=1)

    def _values(self, name: str, local: Array, points: Array | None = None) -> Array:
        if name in PARAMETERS:
            d = PARAMETERS.index(name)
            return self.checked.map.values(d, local[:, d])[:, None]
        return local_field(self.checked.analysis, name).checked_at(local, points)

    @cached_property
    def _nodes(self) -> Array:
        return self.places.nodes()

    @cached_property
    def _known(self) -> dict[tuple[str, str], Array | dict[str, Array]]:
        return {}

    def _elements(self, kind: str) -> Array:
        found = self._known.get(("elements", kind))
        if found is None:
            found = self._known["elements", kind] = self.places.elements(kind)
        assert isinstance(found, np.ndarray)
        return found

    def _facets(self, side: str) -> dict[str, Array]:
        found = self._known.get(("facets", side))
        if found is None:
            found = self._known["facets", side] = self.places.facets(side)
        assert isinstance(found, dict)
        return found
