"""Sines and cosines of sums, written out parameter by parameter."""

from __future__ import annotations

from collections.abc import Iterable
from functools import lru_cache
from typing import Final

from pc2cad.expression.normal_form import normal_form
from pc2cad.expression.recent import Holding
from pc2cad.expression.rewriting import rewrite
from pc2cad.expression.tree import ONE, ZERO, Expr, call, number, power

_WAVES: Final = frozenset(("sin", "cos"))


def _has_waves(node: Expr) -> bool:
    return bool(node.symbols) and not _WAVES.isdisjoint(node.ops)


def _has_no_sum(node: Expr) -> bool:
    return node.op not in _WAVES or _sum_apart(node) is node


#: nodes without sines or cosines of sums
_plain: Final = Holding(_has_no_sum, lambda node: tuple(filter(_has_waves, node.args)))


def are_plain(nodes: Iterable[Expr]) -> bool:
    """Say whether trees hold no sine or cosine of a sum that `parted` would write out."""
    return _plain.of(tuple(filter(_has_waves, nodes)))


@lru_cache(maxsize=1024)
def parted(root: Expr) -> Expr:
    """Return a tree with sines and cosines of sums written out, parameter by parameter.

    Cells side by side often have a coordinate in common.
    """
    if are_plain((root,)):
        return root
    (written,) = rewrite(rewrite((root,), "sin", _sum_apart), "cos", _sum_apart)
    return written


@lru_cache(maxsize=1024)
def _sum_apart(node: Expr) -> Expr:
    parts = _parts(node.args[0])
    if parts is None or len(parts) < 2:
        return node
    sine, cosine = ZERO, ONE
    for part in parts:
        s, c = call("sin", part), call("cos", part)
        sine, cosine = sine * c + cosine * s, cosine * c - sine * s
    return sine if node.op == "sin" else cosine


def _parts(argument: Expr) -> list[Expr] | None:
    """Return the argument's parts, one per parameter and the constant; None if it has mixed terms.

    Whole parts only: a part in u may hold any function of u.
    """
    form = normal_form(argument, largest=24)
    if form is None:
        return None
    parts: dict[str, Expr] = {}
    for monomial in sorted(form, key=repr):
        names = frozenset().union(*(atom.symbols for atom, _ in monomial))
        if len(names) > 1:
            return None
        term = number(form[monomial])
        for atom, exponent in sorted(monomial, key=repr):
            term = term * power(atom, number(exponent))
        key = next(iter(names), "")
        parts[key] = parts.get(key, ZERO) + term
    return list(parts.values())
