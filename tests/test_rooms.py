"""Who may import whom, how large things may be, and what no module may do."""

from __future__ import annotations

import ast
import re
from collections.abc import Iterator

import pytest
import rooms

from pc2cad import __version__  # noqa: F401  (the root has to load without its rooms)

ROOT_NAMES = 32
LONGEST_CHAIN = 14
LONGEST_MODULE = 400
LONGEST_FUNCTION = 50


@pytest.mark.parametrize("room", rooms.LAYERS)
def test_a_room_imports_only_what_the_table_allows(room: str) -> None:
    inside = [module for module in rooms.modules().values() if module.room == room]
    assert inside
    allowed = {*rooms.LAYERS[room], *rooms.FREE, room, "__init__"}
    for module in inside:
        found = {name.partition(".")[0] for name in rooms.depends(module)}
        assert found <= allowed, f"{module.name} imports {found - allowed}"


@pytest.mark.parametrize("room", [room for room in rooms.OUTSIDE if room != "cli"])
def test_the_outside_uses_only_the_fronts_of_its_neighbours(room: str) -> None:
    others = set(rooms.OUTSIDE) - {room, *rooms.FRONTS}
    inside = [module for module in rooms.modules().values() if module.room == room]
    assert inside
    for module in inside:
        found = {name.partition(".")[0] for name in rooms.depends(module)}
        assert not found & others, f"{module.name} imports {found & others}"


def test_every_name_at_the_root_is_a_room() -> None:
    names = {module.room for module in rooms.modules().values()} - {"__init__", "__main__"}
    assert names == {*rooms.LAYERS, *rooms.OUTSIDE}
    assert len(names) <= ROOT_NAMES


def test_the_only_circle_is_that_of_the_expression_trees() -> None:
    (circle,) = rooms.circles()
    assert {name.partition(".")[0] for name in circle} == {"expression"}


def test_the_longest_chain_of_rooms() -> None:
    chain = max((c for room, c in rooms.chains().items() if room != "__main__"), key=len)
    assert 5 < len(chain) <= LONGEST_CHAIN, " -> ".join(chain)


@pytest.mark.parametrize("library", rooms.LIBRARIES)
def test_who_loads_a_library(library: str) -> None:
    using = {m.name for m in rooms.modules().values() if library in m.imports}
    assert using
    for name in using:
        assert any(
            name == room or name.startswith(f"{room}.") for room in rooms.LIBRARIES[library]
        ), f"{name} loads {library}"


def test_modules_and_functions_are_of_a_size_to_be_read() -> None:
    lengths = {m.name: len(m.path.read_text().splitlines()) for m in rooms.modules().values()}
    assert len(lengths) > 200
    assert {name: n for name, n in lengths.items() if n > LONGEST_MODULE} == {}
    long = {
        f"{module.name}.{node.name}": length
        for module in rooms.modules().values()
        for node in ast.walk(module.tree)
        if isinstance(node, ast.FunctionDef)
        and (length := (node.end_lineno or 0) - node.lineno + 1) > LONGEST_FUNCTION
    }
    assert long == {}


def test_a_room_says_what_it_holds() -> None:
    for room in (*rooms.LAYERS, *rooms.OUTSIDE):
        assert 20 < len(rooms.holds(room)) < 200, room


def test_pages_name_modules_and_types_that_are_there() -> None:
    known = set(rooms.modules())
    for name, module in rooms.modules().items():
        known |= {f"{name}.{defined}" for defined in _defined(module.tree)}
    pages = sorted((rooms.PACKAGE.parent / "docs" / "rooms").glob("*.md"))
    rows = [row for page in pages for row in re.findall(r"^\| (`.+?) \|", page.read_text(), re.M)]
    named = {name for row in rows for name in re.findall(r"`([\w.]+)`", row)}
    assert len(pages) > 15
    assert len(named) > 50
    assert named <= known, named - known


def test_paths_that_contributors_are_sent_to_exist() -> None:
    root = rooms.PACKAGE.parent
    text = (root / "CONTRIBUTING.md").read_text()
    paths = re.findall(r"`([\w/]+(?:\.\w+|/))`", text)
    assert len(paths) > 30
    missing = [
        p for p in paths if not any((place / p).exists() for place in (root, root / "pc2cad"))
    ]
    assert missing == ["templates/NAME.toml"]


def _defined(tree: ast.Module) -> Iterator[str]:
    """Yield the names that a module defines at its top."""
    for node in tree.body:
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield node.name
        elif isinstance(node, ast.Assign):
            yield from (target.id for target in node.targets if isinstance(target, ast.Name))
        elif isinstance(node, ast.AnnAssign) and isinstance(node.target, ast.Name):
            yield node.target.id


def test_the_table_of_the_design_page_is_this_one() -> None:
    page = (rooms.PACKAGE.parent / "docs" / "design.md").read_text()
    assert rooms.table() in page, "python docs/make_rooms.py writes it anew"


def test_the_figure_of_the_design_page_is_that_of_the_rooms(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.syspath_prepend(rooms.PACKAGE.parent / "docs")
    from make_rooms import FIGURE, figure

    assert FIGURE.read_text(encoding="utf-8") == figure(), "python docs/make_rooms.py draws it"


def test_topology_takes_the_three_valued_answer_only() -> None:
    taken = {
        name
        for module in rooms.modules().values()
        if module.room == "topology"
        for name in rooms.depends(module)
        if not name.startswith("topology")
    }
    assert taken <= {"expression.identity", "errors"}


def test_no_text_is_ever_evaluated() -> None:
    called = {
        node.func.id
        for module in rooms.modules().values()
        for node in ast.walk(module.tree)
        if isinstance(node, ast.Call) and isinstance(node.func, ast.Name)
    }
    assert "len" in called
    assert not called & {"eval", "exec", "compile", "sympify", "parse_expr"}


def test_a_process_is_forked_while_it_is_small_or_not_at_all() -> None:
    """A fork after the kernel has run hangs in it; clocks that are set would spoil durations."""
    forking, clocks, monotonic = set(), set(), set()
    for module in rooms.modules().values():
        for node in ast.walk(module.tree):
            if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
                name = f"{node.value.id}.{node.attr}"
                forking |= {module.name} if name in ("os.fork", "os.forkpty") else set()
                clocks |= {module.name} if name == "time.time" else set()
                monotonic |= {module.name} if name == "time.monotonic" else set()
        if "multiprocessing" in module.imports:
            spawns = 'get_context("spawn")' in module.path.read_text()
            forking |= set() if spawns else {module.name}
    assert forking == {"cli.guard"}
    assert monotonic
    assert clocks == set()


def test_nothing_needs_scipy_interpolate() -> None:
    # it costs as long to import as all of NumPy, and splines are evaluated here
    texts = [path.read_text() for path in rooms.PACKAGE.rglob("*.py")]
    assert len(texts) > 100
    assert not any("scipy.interpolate" in text for text in texts)
