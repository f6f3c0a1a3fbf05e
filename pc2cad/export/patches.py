"""How the patches of a volume model lie next to one another."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from pc2cad.representation.volume import Patch, VolumeModel
from pc2cad.topology.cells import IDENTITY, Cell, SideKey, Symmetry
from pc2cad.topology.complex import SideFate


@dataclass(frozen=True)
class Interface:
    """Two sides of patches that are one: `axes[k]` is the second patch's axis for the first's k.

    `forward[k]` says whether the first patch's axis k runs as the second's does. A side is
    ``2·axis + upper``.
    """

    first: int
    first_side: int
    second: int
    second_side: int
    axes: tuple[int, int, int]
    forward: tuple[bool, bool, bool]


def sides(model: VolumeModel) -> Iterator[tuple[int, int, SideKey, SideFate | None]]:
    """Give patch, side, key and fate of every side of a patch on the box; fate None inside."""
    fates = {side.patch: side for side in model.boundary.sides}
    for index, patch in enumerate(model.patches):
        for side in range(6):
            cell = _cell(model, patch, side)
            key = model.side_key(patch, side // 2, bool(side % 2))
            yield index, side, key, fates.get(cell)


def interfaces(model: VolumeModel) -> list[Interface]:
    """Return the sides that neighbouring patches share, and those that the solid glues."""
    at: dict[Cell, list[tuple[int, int]]] = {}
    for index, patch in enumerate(model.patches):
        for side in range(6):
            at.setdefault(_cell(model, patch, side), []).append((index, side))
    found = []
    for places in at.values():
        if len(places) == 2:
            (first, side), (second, other) = places
            found.append(_interface(model, first, side, second, other, IDENTITY))
    fates = {side.patch: side for side in model.boundary.sides}
    for index, side, _, fate in sides(model):
        if fate is None or fate.partner is None or fate.symmetry is None:
            continue
        other, other_side = at[fate.partner][0]
        if (index, side) < (other, other_side) and fates[fate.partner].partner == fate.patch:
            found.append(_interface(model, index, side, other, other_side, fate.symmetry))
    return found


def _cell(model: VolumeModel, patch: Patch, side: int) -> Cell:
    cell = list(patch.cell)
    cell[model.directions[side // 2]] += 1 if side % 2 else -1
    return cell[0], cell[1], cell[2]


def _interface(
    model: VolumeModel, first: int, side: int, second: int, other: int, symmetry: Symmetry
) -> Interface:
    """Translate first(s, t) = second(symmetry(s, t)) from directions to axes."""
    axis_of = [model.directions.index(d) for d in range(3)]
    normal = model.directions[side // 2], model.directions[other // 2]
    s, t = (d for d in range(3) if d != normal[0])
    there = [d for d in range(3) if d != normal[1]]
    reverse = [symmetry.reverse_s, symmetry.reverse_t]
    axes, forward = [0, 0, 0], [True, True, True]
    axes[axis_of[normal[0]]] = axis_of[normal[1]]
    forward[axis_of[normal[0]]] = side % 2 != other % 2
    for k, d in enumerate((s, t)):
        place = 1 - k if symmetry.swap else k
        axes[axis_of[d]] = axis_of[there[place]]
        forward[axis_of[d]] = not reverse[place]
    return Interface(first, side, second, other, (axes[0], axes[1], axes[2]),
                     (forward[0], forward[1], forward[2]))  # fmt: skip
