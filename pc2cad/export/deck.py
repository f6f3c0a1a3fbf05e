"""Jobs for CalculiX: a mesh with materials, supports, loads and one step, as one .inp file.

Pressures and fluxes are given face by face of the elements (``*DLOAD``, ``*DFLUX``): the program
reads them on named surfaces and loads nothing.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Literal, TextIO

from pc2cad.errors import InputError
from pc2cad.export.files import replacing
from pc2cad.export.graded import at_nodes, bins_of, scalar_column
from pc2cad.export.inp import TYPES, digits, facets, put, put_rows, set_names
from pc2cad.export.oriented import ORIENTATION, check_orientation, orientation
from pc2cad.mesh.volume_mesh import VolumeMesh

Analysis = Literal["static", "frequency", "heat"]
#: element -> the shape that it is of, and its order
ELEMENTS: dict[str, tuple[str, Literal[1, 2]]] = {
    "C3D8": ("hexahedron", 1), "C3D8I": ("hexahedron", 1), "C3D20": ("hexahedron", 2),
    "C3D20R": ("hexahedron", 2), "C3D4": ("tetra", 1), "C3D10": ("tetra", 2),
}  # fmt: skip
#: analysis -> what it must know of each material
NEEDS: dict[Analysis, tuple[str, ...]] = {
    "static": ("E", "nu"), "frequency": ("E", "nu", "rho"), "heat": ("k",),
}  # fmt: skip
AXES = "xyz"
#: properties along the axes of a material that is orthotropic, in the order of the program's input
ELASTIC = ("E1", "E2", "E3", "nu12", "nu13", "nu23", "G12", "G13", "G23")
CONDUCTING = ("k1", "k2", "k3")
#: what a message names for a value that is missing
EXAMPLES = {"nu": "0.3", "rho": "7.85e-9", "k": "50", "alpha": "12e-6"}


#: what a user calls some of a job's loads
_WORDS = {
    "fixed": "sides that are held",
    "moved": "sides that are moved",
    "warm": "field of warmth",
}


@dataclass(frozen=True)
class Material:
    """A material, in units that fit the part's (mm, N, MPa, tonne/mm^3, mW/(mm K)).

    It is isotropic, or has constants along axes 1, 2 and 3 (x, y and z, or what a deck's `oriented`
    says). A text names the scalar field of the part that a property is.
    """

    #: Young's modulus and Poisson's ratio
    E: float | str | None = None
    nu: float | str | None = None
    #: density
    rho: float | str | None = None
    #: conductivity
    k: float | str | None = None
    #: thermal expansion, a strain per degree
    alpha: float | str | None = None
    #: Young's moduli, Poisson's ratios and shear moduli of an orthotropic material
    E1: float | str | None = None
    E2: float | str | None = None
    E3: float | str | None = None
    nu12: float | str | None = None
    nu13: float | str | None = None
    nu23: float | str | None = None
    G12: float | str | None = None
    G13: float | str | None = None
    G23: float | str | None = None
    #: its conductivities
    k1: float | str | None = None
    k2: float | str | None = None
    k3: float | str | None = None

    def __post_init__(self) -> None:
        for entry in fields(self):
            value = getattr(self, entry.name)
            if value is None or isinstance(value, str):
                continue
            if entry.name == "nu":
                if not -1 < value < 0.5:
                    raise InputError(f"nu lies between -1 and 0.5, and is not {value:g}")
            elif entry.name.startswith("nu"):
                if not abs(value) < float("inf"):
                    raise InputError(f"{entry.name} is a number, and not {value:g}")
            elif not 0 < value < float("inf"):
                raise InputError(f"a material's {entry.name} is positive, and not {value:g}")
        self._check_stable()

    def _check_stable(self) -> None:
        """Refuse ratios with which some stress would give off energy."""
        E1, E2, E3, a, b, c = (getattr(self, name) for name in ELASTIC[:6])
        values = [x for x in (E1, E2, E3, a, b, c) if not (x is None or isinstance(x, str))]
        if len(values) < 6:
            return
        # the compliances over the roots of those on the diagonal: 1, and these beside it
        a, b, c = a * (E2 / E1) ** 0.5, b * (E3 / E1) ** 0.5, c * (E3 / E2) ** 0.5
        if not (max(abs(a), abs(b), abs(c)) < 1 and 1 - a * a - b * b - c * c > 2 * a * b * c):
            raise InputError(
                "no material has these nu12, nu13, nu23: its elastic energy would be negative "
                "(nu12 is below the root of E1/E2 …)"
            )

    def along(self, names: Sequence[str]) -> bool:
        """Return whether the material has some of the constants of an orthotropic one."""
        return any(getattr(self, name) is not None for name in names)

    @property
    def graded(self) -> dict[str, str]:
        """The properties that are fields, and their names."""
        values = {entry.name: getattr(self, entry.name) for entry in fields(self)}
        return {name: value for name, value in values.items() if isinstance(value, str)}


@dataclass(frozen=True)
class Deck:
    """What a job asks: how the part is held and loaded, and what of."""

    analysis: Analysis
    #: layer -> its material; "" is that of the whole part, or of all other layers
    materials: Mapping[str, Material]
    #: side -> the directions in which its nodes are held, of "xyz"
    fixed: Mapping[str, str] = field(default_factory=dict)
    #: side -> pressure on it, positive inwards
    pressures: Mapping[str, float] = field(default_factory=dict)
    #: side -> its temperature
    temperatures: Mapping[str, float] = field(default_factory=dict)
    #: side -> heat that enters through it per area and time
    fluxes: Mapping[str, float] = field(default_factory=dict)
    #: how the elements that are hexahedra or tetrahedra are called, of `ELEMENTS`
    element: str = "C3D20R"
    #: number of frequencies
    modes: int = 10
    #: the field that is the temperature: all over, where 0 is free of stress, or of heat's start
    warm: str | None = None
    #: sections that a material is parted into for each property that is a field
    bins: int = 20
    #: side and direction -> how far its nodes are moved that way, or the field that says it
    moved: Mapping[tuple[str, str], float | str] = field(default_factory=dict)
    #: axis 1 of materials, and what lies with it in the plane of axes 1 and 2: each u, v or w
    #: (along ∂M/∂u, …), ``guide``, or a field of vectors
    oriented: tuple[str, str] | None = None

    def __post_init__(self) -> None:
        if self.element not in ELEMENTS:
            raise InputError(f"elements are {', '.join(ELEMENTS)}, and not {self.element[:20]}")
        if not 1 <= self.modes <= 1000:
            raise InputError(f"a job asks for 1 to 1000 frequencies, and not {self.modes}")
        if not 1 <= self.bins <= 1000:
            raise InputError(f"a field is parted into 1 to 1000 bins, and not {self.bins}")
        loads = {
            "warm": "static heat", "fixed": "static frequency", "pressures": "static",
            "moved": "static", "temperatures": "heat", "fluxes": "heat",
        }  # fmt: skip
        for name, analyses in loads.items():
            if getattr(self, name) and self.analysis not in analyses.split():
                raise InputError(f"a job of {self.analysis} has no {_WORDS.get(name, name)}")
        self._check_held()
        for name, material in self.materials.items():
            needs = _needs(self.analysis, material)
            if self.analysis == "static" and self.warm:
                needs.append("alpha")
            missing = [key for key in needs if getattr(material, key) is None]
            if missing:
                of = f" of {name}" if name else ""
                raise InputError(
                    f"a job of {self.analysis} needs {', '.join(missing)}{of}: for example "
                    f"{missing[0]}={EXAMPLES.get(missing[0], '210e3')}"
                )

    def _check_held(self) -> None:
        for side, axes in self.fixed.items():
            if not axes or set(axes) - set(AXES):
                raise InputError(f"{side} is held along x, y or z, and not '{axes[:20]}'")
        for side, axis in self.moved:
            if axis not in AXES or axis in self.fixed.get(side, ""):
                raise InputError(
                    f"{side} is moved along x, y or z, along which it is not held, and not "
                    f"'{axis[:20]}'"
                )
        held = "".join((*self.fixed.values(), *(axis for _, axis in self.moved)))
        free = [axis for axis in AXES if axis not in held]
        if self.analysis == "static" and free:
            raise InputError(f"nothing holds the part along {' and '.join(free)}: fix a side")
        if self.analysis == "heat" and not self.temperatures:
            raise InputError("no side has a temperature: give one, from which others are counted")


def _needs(analysis: Analysis, material: Material) -> list[str]:
    """Return what a material must have; of an orthotropic one all of its constants."""
    needs = [*NEEDS[analysis]]
    if analysis == "heat":
        return [*CONDUCTING] if material.along(CONDUCTING) else needs
    return [*ELASTIC, *needs[2:]] if material.along(ELASTIC) else needs


def write_deck(mesh: VolumeMesh, path: str | os.PathLike[str], deck: Deck) -> None:
    """Write a job that CalculiX runs as it is (``ccx -i job``), whole or not at all.

    Source: G. Dhondt, CalculiX CrunchiX user's manual 2.20, sections 6 and 7.

    Raises InputError where the mesh has no such side, layer or elements, FileNotWrittenError.
    """
    types = _types(mesh, deck.element)
    _check_names(mesh, deck)
    with replacing(path) as temporary, open(temporary, "w", encoding="ascii", newline="\n") as out:
        put(out, mesh, types)
        if deck.oriented is not None:
            out.writelines(f"{line}\n" for line in orientation(mesh, *deck.oriented))
        out.writelines(f"{line}\n" for line in _materials(mesh, deck))
        out.writelines(f"{line}\n" for line in _supports(mesh, deck))
        _step(out, mesh, deck)


def _types(mesh: VolumeMesh, element: str) -> dict[str, str]:
    shape, order = ELEMENTS[element]
    if shape not in mesh.blocks or mesh.order != order:
        raise InputError(
            f"{element} are elements of order {order} of the shape {shape}, and the mesh has "
            f"{', '.join(mesh.blocks)} of order {mesh.order}"
        )
    return {kind: pair[order - 1] for kind, pair in TYPES.items()} | {shape: element}


def _check_names(mesh: VolumeMesh, deck: Deck) -> None:
    faces = {*deck.pressures, *deck.fluxes}
    nodes = {*deck.fixed, *deck.temperatures, *(side for side, _ in deck.moved)}
    for name in sorted(faces | nodes):
        if name not in (mesh.sides if name in faces else mesh.node_sets):
            raise InputError(f"no side is called '{name[:40]}': there are {', '.join(mesh.sides)}")
    named = [deck.warm, *(f for m in deck.materials.values() for f in m.graded.values())]
    for column in (*named, *deck.moved.values()):
        if isinstance(column, str):
            scalar_column(mesh, column)
    if deck.oriented is not None:
        check_orientation(mesh, deck.oriented)
    for name in deck.materials:
        if name and name not in mesh.layers:
            there = f"they are {', '.join(mesh.layers)}" if mesh.layers else "the part has none"
            raise InputError(f"no layer is called '{name[:40]}': {there}")
    for name in mesh.layers or [""]:
        if name not in deck.materials and "" not in deck.materials:
            raise InputError(f"layer {name} has no material" if name else "there is no material")


def _materials(mesh: VolumeMesh, deck: Deck) -> Iterator[str]:
    names = set_names(mesh)
    for number, (name, material) in enumerate(deck.materials.items(), start=1):
        own = [name] if name else [each for each in mesh.layers if each not in deck.materials]
        if material.graded:
            yield from _graded(mesh, deck, material, own, number)
            continue
        yield from _material(deck, material, f"material_{number}")
        for each in own if mesh.layers else [None]:
            elements = "solid" if each is None else names[each]
            yield _section(deck, elements, f"material_{number}")


def _section(deck: Deck, elements: str, material: str) -> str:
    turned = "" if deck.oriented is None else f", ORIENTATION={ORIENTATION}"
    return f"*SOLID SECTION, ELSET={elements}, MATERIAL={material}{turned}"


def _material(deck: Deck, material: Material, name: str) -> Iterator[str]:
    yield f"*MATERIAL, NAME={name}"
    if deck.analysis == "heat":
        if material.along(CONDUCTING):
            yield f"*CONDUCTIVITY, TYPE=ORTHO\n{_row(material, CONDUCTING)}"
        else:
            yield f"*CONDUCTIVITY\n{_row(material, ('k',))}"
    elif material.along(ELASTIC):
        # a line of constants has eight
        yield "*ELASTIC, TYPE=ENGINEERING CONSTANTS"
        yield f"{_row(material, ELASTIC[:8])},\n{_row(material, ELASTIC[8:])}"
    else:
        yield f"*ELASTIC\n{_row(material, ('E', 'nu'))}"
    if deck.analysis == "frequency":
        yield f"*DENSITY\n{_row(material, ('rho',))}"
    if deck.analysis == "static" and deck.warm:
        yield f"*EXPANSION\n{_row(material, ('alpha',))}"


def _row(material: Material, names: Sequence[str]) -> str:
    return ", ".join(digits(getattr(material, name)) for name in names)


def _graded(
    mesh: VolumeMesh, deck: Deck, material: Material, layers: Sequence[str], number: int
) -> Iterator[str]:
    """Give a section for each bin of a material that varies; its set has a name of no other."""
    taken = {name.lower() for name in set_names(mesh).values()}
    parts = bins_of(mesh, layers if mesh.layers else (), material.graded, deck.bins)
    for k, part in enumerate(parts, start=1):
        name = f"material_{number}_{k}"
        while name in taken:
            name += "_"
        yield from _material(deck, replace(material, **part.values), name)
        yield f"*ELSET, ELSET={name}"
        numbers = part.elements.tolist()
        for start in range(0, len(numbers), 12):
            yield ", ".join(map(str, numbers[start : start + 12]))
        yield _section(deck, name, name)


def _supports(mesh: VolumeMesh, deck: Deck) -> Iterator[str]:
    names = set_names(mesh)
    if deck.fixed:
        yield "*BOUNDARY"
    for side, axes in deck.fixed.items():
        for axis in sorted({1 + AXES.index(axis) for axis in axes}):
            yield f"{names[side]}, {axis}, {axis}"
    if deck.analysis == "heat" or deck.warm:
        yield "*INITIAL CONDITIONS, TYPE=TEMPERATURE"
        start = deck.warm if deck.analysis == "heat" else None
        yield from ["solid, 0."] if start is None else _warm(mesh, start)


def _warm(mesh: VolumeMesh, field: str) -> Iterator[str]:
    """Give the temperature of every node."""
    for number, value in enumerate(at_nodes(mesh, field).tolist(), start=1):
        yield f"{number}, {digits(value)}"


def _moved(mesh: VolumeMesh, deck: Deck) -> Iterator[str]:
    """Give each node of a side that is moved its way along an axis."""
    names = set_names(mesh)
    for (side, axis), way in deck.moved.items():
        row = 1 + AXES.index(axis)
        if not isinstance(way, str):
            yield f"{names[side]}, {row}, {row}, {digits(way)}"
            continue
        nodes = mesh.node_sets[side]
        for node, value in zip(nodes.tolist(), at_nodes(mesh, way)[nodes].tolist(), strict=True):
            yield f"{node + 1}, {row}, {row}, {digits(value)}"


def _step(out: TextIO, mesh: VolumeMesh, deck: Deck) -> None:
    names = set_names(mesh)
    procedure = {
        "static": "*STATIC", "frequency": f"*FREQUENCY\n{deck.modes}",
        "heat": "*HEAT TRANSFER, STEADY STATE",
    }[deck.analysis]  # fmt: skip
    out.write(f"*STEP\n{procedure}\n")
    if deck.moved:
        out.write("*BOUNDARY\n")
        out.writelines(f"{line}\n" for line in _moved(mesh, deck))
    if deck.temperatures:
        out.write("*BOUNDARY\n")
        out.writelines(f"{names[s]}, 11, 11, {digits(t)}\n" for s, t in deck.temperatures.items())
    if deck.warm and deck.analysis == "static":
        out.write("*TEMPERATURE\n")
        out.writelines(f"{line}\n" for line in _warm(mesh, deck.warm))
    for keyword, letter, loads in (("*DLOAD", "P", deck.pressures), ("*DFLUX", "S", deck.fluxes)):
        for side, value in loads.items():
            out.write(f"{keyword}\n")
            put_rows(out, f"%d, {letter}%d, {digits(value)}\n", facets(mesh, side))
    found = ("NT, RFL", "HFL") if deck.analysis == "heat" else ("U", "S")
    if deck.analysis == "static":
        found = ("U, RF", "S")
    out.write(f"*NODE FILE\n{found[0]}\n*EL FILE\n{found[1]}\n*END STEP\n")
