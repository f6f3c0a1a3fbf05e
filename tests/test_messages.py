"""One dialect of messages: they begin in lower case and end without a full stop."""

from __future__ import annotations

import ast
from collections.abc import Iterator

import pytest
import rooms

from pc2cad.errors import InputError, named

#: names and symbols that a message may begin with
PROPER = ("M ", "Dask ", "Parquet ", "SymPy", "VTK ")


def text(node: ast.expr) -> str:
    """Return a literal with a mark where a value stands."""
    if isinstance(node, ast.Constant) and isinstance(node.value, str):
        return node.value
    if isinstance(node, ast.JoinedStr):
        return "".join(text(value) for value in node.values)
    if isinstance(node, ast.BinOp):
        return text(node.left) + text(node.right)
    if isinstance(node, ast.IfExp):
        return text(node.body)
    return "…"


def messages() -> Iterator[tuple[str, str]]:
    """Yield the place and the text of every error that is made of a literal."""
    for module in rooms.modules().values():
        for node in ast.walk(module.tree):
            if not isinstance(node, ast.Call) or not node.args:
                continue
            name = ast.unparse(node.func).rpartition(".")[2]
            if name.endswith("Error") and (found := text(node.args[0])) != "…":
                yield f"{module.name}:{node.lineno}", found


def _named(words: str) -> bool:
    """Return whether a message begins with a proper name, or an entity's in capitals."""
    return words.startswith(PROPER) or (len(words.split()[0]) > 1 and words.split()[0].isupper())


def test_messages_are_of_one_dialect() -> None:
    found = list(messages())
    assert len(found) > 350
    wrong = [
        (place, words)
        for place, words in found
        if (words[:1].isupper() and not _named(words)) or words.endswith(".")
    ]
    assert wrong == []


def test_a_subject_is_put_before_a_message_once() -> None:
    with pytest.raises(InputError, match=r"^part: no such thing$"), named("part"), named("part"):
        raise InputError("no such thing")
