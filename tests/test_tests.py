"""The tests themselves: no test has all its assertions in loops that may go through nothing."""

from __future__ import annotations

import ast
from pathlib import Path

import pytest

FILES = sorted(Path(__file__).parent.glob("test_*.py"))
#: calls whose figures, written out, say how often a loop goes
COUNTED = {"range", "linspace", "arange", "product"}


def goes(node: ast.expr, known: set[str]) -> bool:
    """Whether a loop over this goes at least once as the text alone shows.

    So it does over a literal, a table of the module (in capitals), what the test is given or has
    written out before (`known`), and what is made of these.
    """
    match node:
        case ast.Name(name):
            return name in known or name.isupper()
        case ast.Tuple(parts) | ast.List(parts) | ast.Set(parts) | ast.Dict(parts):
            return bool(parts)
        case ast.Constant(str() as text):
            return bool(text)
        case ast.Subscript(value) | ast.Attribute(value):
            return goes(value, known)
        case ast.BinOp(left, _, right):
            return goes(left, known) or goes(right, known)
        case ast.Call(ast.Name("zip"), parts, keywords):
            strict = any(word.arg == "strict" for word in keywords)
            return (any if strict else all)(goes(part, known) for part in parts)
        case ast.Call(ast.Name(name) | ast.Attribute(_, name)) if name in COUNTED:
            return True
        case ast.Call(ast.Attribute(value), []):
            return goes(value, known)
        case ast.Call(ast.Name(), [first, *_]):
            return goes(first, known)
    return False


def asserts(block: list[ast.stmt], known: set[str]) -> tuple[bool, list[int]]:
    """Return whether a block asserts for certain, and the lines of loops that may not."""
    certain, loops = False, []
    for node in block:
        match node:
            case ast.Assert():
                certain = True
            case ast.Assign([ast.Name(name)], ast.Tuple() | ast.List() | ast.Set() | ast.Dict()):
                known = known | ({name} if goes(node.value, known) else set())
            case ast.For(_, over, body):
                inner, found = asserts(body, known)
                once = goes(over, known)
                certain |= inner and once
                loops += found if once or not inner else [node.lineno]
            case ast.With(items, body):
                inner, found = asserts(body, known)
                words = ("raises(", "warns(")
                certain |= inner or any(w in ast.unparse(i) for i in items for w in words)
                loops += found
            case ast.Expr(ast.Call(called)) if "check" in ast.unparse(called) or (
                "assert" in ast.unparse(called)
            ):
                certain = True  # a function of the tests that asserts
            case ast.If(_, body, other) | ast.Try(body, _, other):
                parts = [asserts(part, known) for part in (body, other)]
                certain |= all(inner for inner, _ in parts)
                loops += [line for _, found in parts for line in found]
    return certain, loops


@pytest.mark.parametrize("path", FILES, ids=lambda path: path.stem)
def test_no_test_asserts_only_in_loops_that_may_be_empty(path: Path) -> None:
    refused = []
    for node in ast.parse(path.read_text()).body:
        if isinstance(node, ast.FunctionDef) and node.name.startswith("test_"):
            arguments = {each.arg for each in node.args.args}
            certain, loops = asserts(node.body, arguments)
            if loops and not certain:
                refused.append(f"{path.name}:{loops[0]}: count what this loop goes through first")
    assert refused == []


LOOPS = {
    "for x in found(): assert x": False,
    "for x in found: assert x": True,  # an argument
    "for x in TABLE['a'].items(): assert x": True,
    "for x in []: assert x": False,
    "for x in sorted(made()): assert x": False,
    "for x in range(3):\n  for y in made(): assert y": False,
    "for x in zip(made(), (1, 2), strict=True): assert x": True,
    "for x in zip(made(), (1, 2)): assert x": False,
    "made = f()\nassert len(made) == 2\nfor x in made: assert x": True,
    "made = f()\nfor x in made: assert x": False,
    "made = 1, 2\nfor x in made: assert x": True,
    "with raises(E): f()": True,
}


@pytest.mark.parametrize("text", LOOPS)
def test_loops_are_told_apart(text: str) -> None:
    certain, loops = asserts(ast.parse(text).body, {"found"} if "found:" in text else set())
    assert (certain or not loops) == LOOPS[text]
