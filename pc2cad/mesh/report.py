"""What a volume mesh is, how good its elements are, and how it compares with the equation."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from pc2cad.checked import CheckedMap
from pc2cad.mesh.quality import Quality
from pc2cad.mesh.volume_mesh import VolumeMesh, by_whole_side
from pc2cad.topology.cells import SideKey


@dataclass(frozen=True)
class SideMeasure:
    """A side of the solid: its facets against the equation (areas in model units squared)."""

    facets: int
    area: float
    equation_area: float


@dataclass(frozen=True)
class LayerMeasure:
    """A layer of the solid: its elements against the equation (volumes in model units cubed)."""

    elements: int
    volume: float
    equation_volume: float


@dataclass(frozen=True)
class MeshReport:
    """What a mesh is, how good its elements are, and how it compares with the equation."""

    name: str
    units: str
    order: int
    #: cells of the parameter grid along u, v, w; None for a mesh that is not structured
    cells: tuple[int, int, int] | None
    nodes: int
    elements: Mapping[str, int]
    quality: Quality
    volume: float
    equation_volume: float
    sides: Mapping[str, SideMeasure]
    layers: Mapping[str, LayerMeasure] = field(default_factory=dict)
    times: Mapping[str, float] = field(default_factory=dict)

    @property
    def volume_difference(self) -> float:
        """Relative difference of the mesh's volume from the equation's."""
        return self.volume / self.equation_volume - 1

    def to_dict(self) -> dict[str, Any]:
        """Return the report as plain data for JSON."""
        return {**asdict(self), "volume_difference": self.volume_difference}


def report_on(
    mesh: VolumeMesh,
    quality: Quality,
    volumes: tuple[float, Sequence[float]],
    areas: Mapping[str, float],
    cells: tuple[int, int, int] | None,
    times: Mapping[str, float],
) -> MeshReport:
    """Return the report on a mesh; `volumes` (of all, and of each layer) and `areas` are true."""
    sides = {
        side: SideMeasure(sum(len(f.elements) for f in facets), mesh.area(side), areas[side])
        for side, facets in mesh.sides.items()
    }
    layers = {
        name: LayerMeasure(sum(map(len, layer.values())), quality.layers[name], volume)
        for (name, layer), volume in zip(mesh.layers.items(), volumes[1], strict=False)
    }
    return MeshReport(
        mesh.name, mesh.units, mesh.order, cells, len(mesh.points),
        {kind: len(block) for kind, block in mesh.blocks.items()},
        quality, mesh.volume(), volumes[0], sides, layers, times,
    )  # fmt: skip


def side_areas(checked: CheckedMap) -> dict[str, float]:
    """Return the equation's area of every side, and of every patch of a creased one."""
    boundary = checked.analysis.boundary
    keys = [boundary.key(face.patch) for face in boundary.faces]
    return by_side(zip(keys, checked.mass.face_areas, strict=True))


def by_side(measured: Iterable[tuple[SideKey, float]]) -> dict[str, float]:
    """Return areas by name of the side, and those of whole sides where they come in pieces."""
    areas: dict[str, float] = {}
    for side, area in measured:
        for name in by_whole_side(side):
            areas[name] = areas.get(name, 0.0) + area
    return areas
