"""The rooms of pc2cad and who may import whom: docs/design.md's table is made from this."""

from __future__ import annotations

import ast
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path

PACKAGE = Path(__file__).parent.parent / "pc2cad"

#: what every room may use
FREE = ("errors", "arrays", "options", "trust")

#: room -> the rooms that it may import, itself and FREE apart; in the order of the data's way
LAYERS: dict[str, tuple[str, ...]] = {
    "errors": (),
    "arrays": (),
    "options": (),
    "trust": (),
    "report": (),
    "expression": (),
    "equation": ("expression",),
    "channels": ("equation", "expression"),
    "templates": ("channels", "equation", "expression"),
    "api": ("channels", "equation", "expression"),
    "geometry": ("expression",),
    "bounds": ("geometry", "expression"),
    "topology": ("expression",),
    "domain": ("topology", "geometry", "equation", "expression"),
    "solidity": ("domain", "bounds", "topology", "geometry", "equation", "expression"),
    "integrals": ("domain", "topology", "geometry", "equation", "expression"),
    "checked": (
        "integrals", "solidity", "domain", "bounds", "channels", "geometry", "equation",
        "expression",
    ),
    "representation": (
        "checked", "solidity", "domain", "bounds", "topology", "geometry", "expression",
    ),
    "sampling": ("checked", "domain", "topology", "equation", "expression"),
    # held against what the others made: nothing that represents, builds, validates or writes
    "verify": ("sampling", "integrals", "domain", "bounds", "topology", "geometry", "templates",
               "equation", "expression"),
    "mesh": (
        "sampling", "checked", "integrals", "domain", "topology", "geometry", "equation",
        "expression",
    ),
    "brep": ("representation", "topology", "geometry"),
    "validation": (
        "brep", "representation", "checked", "integrals", "solidity", "domain", "topology",
        "geometry", "equation", "expression", "report",
    ),
    "export": ("brep", "mesh", "sampling", "representation", "domain", "topology", "geometry"),
    "part": (
        "export", "brep", "mesh", "sampling", "representation", "checked", "topology", "equation",
        "report",
    ),
    "csg": (
        "part", "export", "validation", "brep", "representation", "sampling", "integrals", "domain",
        "bounds", "topology", "geometry", "templates", "equation", "mesh", "report",
    ),
}  # fmt: skip

#: the outside: each may import everything above
OUTSIDE = ("compiler", "picture", "viewer", "studies", "cadquery", "cli")

#: rooms of the outside that others of it may import; the command line may import all
FRONTS = ("compiler", "picture")

#: library -> the rooms or modules that load it
LIBRARIES: dict[str, tuple[str, ...]] = {
    "OCP": ("brep", "export", "mesh.tetrahedra", "channels.wires", "cadquery", "picture"),
    "cadquery": ("cadquery", "part"),
    "gmsh": ("mesh.tetrahedra",),
    "sympy": ("expression.sympy_bridge",),
}

#: names of the kernel that differ between its versions: to import it is to import OCP
KERNEL = "pc2cad.brep.kernel"


@dataclass(frozen=True)
class Module:
    """A module of the package: its name without ``pc2cad.``, its file and what it imports."""

    name: str
    path: Path
    tree: ast.Module
    imports: frozenset[str]

    @property
    def room(self) -> str:
        """Return the name under the package root, ``__init__`` for the root itself."""
        return self.name.partition(".")[0] or "__init__"


@cache
def modules() -> Mapping[str, Module]:
    """Return every module of the package by its name without ``pc2cad.``."""
    files = {_name(path): path for path in sorted(PACKAGE.rglob("*.py"))}
    trees = {name: ast.parse(path.read_text()) for name, path in files.items()}
    return {
        name: Module(name, files[name], tree, frozenset(_imports(tree, files)))
        for name, tree in trees.items()
    }


def _name(path: Path) -> str:
    parts = path.relative_to(PACKAGE).with_suffix("").parts
    return ".".join(parts[:-1] if parts[-1] == "__init__" else parts)


def _imports(tree: ast.Module, files: Mapping[str, Path]) -> Iterator[str]:
    """Yield what a module imports, lazily or not: own modules as ``.name``, libraries by name."""
    for node in _statements(tree.body):
        if isinstance(node, ast.Import):
            found = [alias.name for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            whole = [f"{node.module}.{alias.name}" for alias in node.names]
            found = [n if n.removeprefix("pc2cad.") in files else node.module for n in whole]
            found = ["OCP" if name == KERNEL else name for name in found]
        else:
            continue
        for name in found:
            top, _, rest = name.partition(".")
            yield f".{rest}" if top == "pc2cad" else top


def _statements(body: Iterable[ast.stmt]) -> Iterator[ast.stmt]:
    """Yield all statements, those within others too, but for what only type checkers see."""
    for node in body:
        if isinstance(node, ast.If) and "TYPE_CHECKING" in ast.unparse(node.test):
            continue
        yield node
        for part in ("body", "orelse", "finalbody"):
            yield from _statements(getattr(node, part, ()))
        for part in ("handlers", "cases"):
            for inner in getattr(node, part, ()):
                yield from _statements(inner.body)


def depends(module: Module) -> set[str]:
    """Return the names of the package's own modules that a module imports."""
    return {name[1:] for name in module.imports if name.startswith(".")} - {"", module.name}


def circles() -> list[set[str]]:
    """Return the sets of modules that import each other in a circle (Tarjan's components)."""
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found: list[set[str]] = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in depends(modules()[name]) & set(modules()):
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            component = set(stack[stack.index(name) :])
            del stack[stack.index(name) :]
            if len(component) > 1:
                found.append(component)

    for name in modules():
        if name not in index:
            visit(name)
    return found


@cache
def chains() -> Mapping[str, tuple[str, ...]]:
    """Return for every room the longest chain of rooms from it, in which each imports the next."""
    rooms: dict[str, set[str]] = {}
    for module in modules().values():
        if module.room != "__init__":
            others = {name.partition(".")[0] for name in depends(module)}
            rooms.setdefault(module.room, set()).update(others - {module.room, "__init__"})

    @cache
    def longest(room: str) -> tuple[str, ...]:
        return (room, *max((longest(other) for other in rooms[room]), key=len, default=()))

    return {room: longest(room) for room in rooms}


def floors() -> dict[str, int]:
    """Return how high a room stands: one above the highest that it imports."""
    return {room: len(below) for room, below in chains().items()}


def holds(room: str) -> str:
    """Return the first sentence of a room's docstring."""
    name = room if room in modules() else f"{room}.__init__"
    text = ast.get_docstring(modules()[name].tree) or ""
    return " ".join(text.split("\n\n")[0].split())


def table() -> str:
    """Return the table of rooms as docs/design.md has it."""
    rows = ["| room | holds | may import |", "|---|---|---|"]
    for room, allowed in LAYERS.items():
        rows.append(f"| `{room}` | {holds(room)} | {', '.join(allowed) or '–'} |")
    for room in OUTSIDE:
        rows.append(f"| `{room}` | {holds(room)} | all above |")
    return "\n".join(rows)
