"""What may be a polynomial of a symbol, or a trigonometric one, by the operations that it meets."""

from __future__ import annotations

from functools import lru_cache

from pc2cad.expression.recent import Holding
from pc2cad.expression.tree import Expr


@lru_cache(maxsize=1024)
def of_powers_or_waves(trees: tuple[Expr, ...], name: str) -> bool:
    """Say whether no operation but those of powers and waves meets a name."""
    return _known(name).of(tuple([root for root in trees if name in root.symbols]))


@lru_cache(maxsize=16)
def _known(name: str) -> Holding:
    """Return what is remembered of a name: cells have most of their nodes in common."""

    def below(node: Expr) -> tuple[Expr, ...]:
        waves = node.op in ("sin", "cos")
        return () if waves else tuple([arg for arg in node.args if name in arg.symbols])

    return Holding(lambda node: _is_power_or_wave(node, name), below)


def _is_power_or_wave(node: Expr, name: str) -> bool:
    if node.op == "pow":
        exponent = node.args[1].payload if node.args[1].op == "number" else None
        return exponent is not None and exponent.denominator == 1 and exponent > 0
    if node.op == "div":
        return name not in node.args[1].symbols
    return node.op in ("symbol", "add", "neg", "mul", "sin", "cos")
