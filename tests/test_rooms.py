"""The table of rooms in docs/design.md: who may import what."""

from __future__ import annotations

import ast
from functools import cache
from pathlib import Path

import pytest

PACKAGE = Path(__file__).parent.parent / "pc2cad"

#: room -> the rooms and outside packages it may import, everywhere in its files
ALLOWED = {
    "errors": set(),
    "options": {"errors"},
    "scale": set(),
    "names": {"errors"},
    "equation": {"equation", "errors", "names", "numpy", "sympy"},
    "mapping": {"equation", "numpy"},
    "topology": {"topology", "equation", "errors"},
    "folding": {"certificate", "equation", "errors", "mapping", "numpy"},
    "analysis": {"equation", "errors", "mapping", "scale", "topology", "numpy"},
    "properties": {
        "analysis", "equation", "errors", "exact_integrals", "folding", "geometry", "mapping",
        "quadrature", "topology", "numpy",
    },
    "exact_integrals": {"analysis", "equation", "topology"},
    "quadrature": {"numpy"},
    "geometry": {"geometry", "equation", "errors", "options", "numpy", "scipy"},
    "enclosure": {"enclosure", "equation", "geometry", "numpy", "scipy"},
    "directions": {"analysis", "equation", "geometry", "mapping", "topology", "numpy"},
    "model": {"geometry", "topology", "numpy"},
    "planar": {"geometry", "model", "topology", "numpy"},
    "courses": {"directions", "equation", "geometry", "numpy"},
    "point_sets": {"directions", "geometry", "numpy"},
    "laying": {"geometry", "model", "topology", "numpy"},
    "proof": {"directions", "enclosure", "equation", "geometry", "model", "topology", "numpy"},
    "tightening": {"errors"},
    "plan": {
        "checked", "courses", "directions", "geometry", "laying", "point_sets", "topology",
    },
    "boundary": {
        "checked", "courses", "directions", "enclosure", "errors", "geometry", "laying", "model",
        "options", "plan", "planar", "proof", "tightening", "topology", "numpy",
    },
    "bodies": {
        "brep", "equation", "errors", "export", "meetings", "part", "report", "validation", "OCP",
    },
    "meetings": {"brep", "enclosure", "geometry", "model", "report", "OCP"},
    "brep": {"brep", "model", "errors", "geometry", "numpy", "scipy", "OCP"},
    "report": set(),
    "wires": {"equation", "numpy", "OCP"},
    "limits": {"equation", "errors", "numpy"},
    "reloading": set(),
    "processes": {"errors"},
    "winding": {"numpy", "scipy"},
    "sheets": {"analysis", "directions", "equation", "geometry", "topology", "winding", "numpy"},
    "blocks": {"sheets", "topology", "numpy"},
    "contact": {"analysis", "blocks", "sheets", "numpy"},
    "continuity": {"analysis", "errors", "sheets", "numpy"},
    "injectivity": {
        "analysis", "contact", "continuity", "equation", "errors", "mapping", "sheets", "winding",
        "numpy",
    },
    "certificate": {"certificate", "enclosure", "equation", "geometry", "mapping", "numpy"},
    "solidity": {"analysis", "injectivity"},
    "checked": {
        "analysis", "equation", "errors", "folding", "limits", "mapping", "options", "properties",
        "scale", "solidity",
    },
    "validation": {
        "checked", "model", "brep", "equation", "errors", "geometry", "properties", "report",
        "scale", "topology", "numpy",
    },
    "export": {
        "export", "errors", "geometry", "interior", "isogeometry", "mesh", "names", "processes",
        "topology", "numpy", "OCP", "lib3mf", "vtkmodules",
    },
    "studies": {
        "studies", "bodies", "compiler", "equation", "errors", "export", "library", "names",
        "options", "part", "picture", "processes", "report", "numpy", "scipy", "__version__",
    },
    "mesh": {
        "mesh", "analysis", "checked", "errors", "mapping", "properties", "topology", "numpy",
        "scipy", "OCP", "gmsh",
    },
    "viewer": {"viewer", "bodies", "errors", "part", "picture", "processes", "report", "numpy"},
    "picture": {
        "picture", "bodies", "equation", "errors", "export", "mapping", "part", "topology", "numpy",
        "OCP", "vtkmodules",
    },
    "interior": {"analysis", "checked", "errors", "mapping", "topology", "numpy", "scipy"},
    "isogeometry": {
        "checked", "courses", "directions", "errors", "geometry", "options", "proof", "tightening",
        "topology", "numpy",
    },
}  # fmt: skip
#: within the equation room only the vectorised evaluations need arrays, and what is made along a
#: guide by numbers: quadrature, frames, interpolating splines
NUMPY_IN_EQUATION = {
    "centred",
    "evaluation",
    "intervals",
    "along",
    "frames",
    "minimising",
    "normals",
    "interpolation",
}
#: what topology takes from the equation room: the three-valued answer, nothing else
TOPOLOGY_FROM_EQUATION = {"pc2cad.expression.identity"}
OUTSIDE = {"numpy", "scipy", "sympy", "OCP", "cadquery", "gmsh", "lib3mf", "vtk", "vtkmodules"}


@cache
def parsed(path: Path) -> ast.Module:
    return ast.parse(path.read_text())


@cache
def imports(path: Path) -> set[str]:
    found: set[str] = set()
    for node in ast.walk(parsed(path)):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:
            found.add(node.module)
            if node.module == "pc2cad":
                found |= {f"pc2cad.{alias.name}" for alias in node.names}
    return found


def room(module: str) -> str | None:
    parts = module.split(".")
    if parts[0] == "pc2cad":
        return parts[1] if len(parts) > 1 else None
    return parts[0] if parts[0] in OUTSIDE else None


def files_of(name: str) -> list[Path]:
    folder = PACKAGE / name
    return sorted(folder.glob("*.py")) if folder.is_dir() else [PACKAGE / f"{name}.py"]


@pytest.mark.parametrize("name", ALLOWED)
def test_room_imports_only_what_the_table_allows(name: str) -> None:
    paths = files_of(name)
    assert paths
    for path in paths:
        found = {room(module) for module in imports(path)} - {None, "__version__"}
        assert found <= ALLOWED[name], f"{path.name} imports {found - ALLOWED[name]}"


def test_every_room_is_in_the_table_or_outside_it() -> None:
    top = {p.stem for p in PACKAGE.iterdir() if p.suffix == ".py" or (p / "__init__.py").exists()}
    outside = {
        "__init__",
        "__main__",
        "cadquery",
        "cli",
        "library",
        "coordinates",
        "compiler",
        "part",
        "python",
    }
    assert top - outside == set(ALLOWED)


def test_numpy_is_loaded_by_the_evaluations_of_the_equation_room_only() -> None:
    using = {p.stem for p in files_of("equation") if "numpy" in {room(m) for m in imports(p)}}
    assert using == NUMPY_IN_EQUATION


def test_topology_knows_no_equations() -> None:
    imported = {module for path in files_of("topology") for module in imports(path)}
    assert {m for m in imported if m.startswith("pc2cad.equation")} == TOPOLOGY_FROM_EQUATION


def test_no_text_is_ever_evaluated() -> None:
    nodes = [node for path in PACKAGE.rglob("*.py") for node in ast.walk(parsed(path))]
    calls = [node.func for node in nodes if isinstance(node, ast.Call)]
    functions = {func.id for func in calls if isinstance(func, ast.Name)}
    methods = {func.attr for func in calls if isinstance(func, ast.Attribute)}
    assert "isinstance" in functions
    assert "append" in methods
    assert not (functions | methods) & {"eval", "exec", "sympify", "parse_expr"}
    assert "compile" not in functions


def test_sympy_is_loaded_by_its_bridge_only() -> None:
    using = {p.stem for p in PACKAGE.rglob("*.py") if "sympy" in {room(m) for m in imports(p)}}
    assert using == {"sympy_bridge"}


def test_a_process_is_forked_while_it_is_small_or_not_at_all() -> None:
    """A fork after the kernel has run hangs in it; clocks that are set would spoil durations."""
    forking, clocks = set(), set()
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(parsed(path)):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                name = f"{node.value.id}.{node.attr}"
                forking |= {path.stem} if name in ("os.fork", "os.forkpty") else set()
                clocks |= {path.stem} if name == "time.time" else set()
        if any(module.startswith("multiprocessing") for module in imports(path)):
            forking |= set() if 'get_context("spawn")' in path.read_text() else {path.stem}
    assert forking == {"guard"}
    assert clocks == set()
