"""Three-valued questions about trees: proved, refuted, or undecided to a stated accuracy."""

from __future__ import annotations

from enum import Enum
from math import cos, isfinite

from pc2cad.expression.normal_form import is_identically_zero
from pc2cad.expression.polynomials import constant_of
from pc2cad.expression.tree import Expr, Number, as_expr

#: Relative size below which a sampled value counts as zero: what rounding leaves of O(1) terms.
ROUNDING = 1e-12


class Verdict(Enum):
    """The answer to a yes/no question about a function."""

    PROVED = "proved"
    REFUTED = "refuted"
    #: true wherever it was sampled, to rounding; no proof was found
    UNDECIDED = "sampled"

    def __bool__(self) -> bool:
        return self is not Verdict.REFUTED


def is_zero(root: Expr, scale: float = 1.0) -> Verdict:
    """Say whether the tree is zero for all values of its symbols.

    Samples are taken at fixed irrational places of (0, 1); values below `ROUNDING` times `scale`
    count as zero. Places where the tree has no finite value are passed over.
    """
    if root.op == "number":
        return Verdict.REFUTED if root.payload else Verdict.PROVED
    if not _seems_constant(root, 0.0, scale):
        return Verdict.REFUTED
    return Verdict.PROVED if is_identically_zero(root) else Verdict.UNDECIDED


def seems_constant(root: Expr, value: Number) -> bool:
    """Say whether a few samples leave it open, for a proof, that the tree equals the constant."""
    constant = float(value)
    return isfinite(constant) and _seems_constant(root, constant, max(1.0, abs(constant)), 2)


def _seems_constant(root: Expr, constant: float, scale: float, samples: int = 6) -> bool:
    values = (_sample(root, shift) - constant for shift in range(samples))
    return not any(isfinite(value) and abs(value) > ROUNDING * scale for value in values)


def is_constant_value(root: Expr, value: Number) -> Verdict:
    """Say whether the tree equals the constant everywhere."""
    if constant_of(root) == as_expr(value).payload:
        return Verdict.PROVED  # as weights of points mostly are
    return is_zero(root - as_expr(value), scale=max(1.0, abs(float(value))))


def _sample(root: Expr, shift: int) -> float:
    """Evaluate at one pseudo-random place; plain floats, so that no numerical library is loaded."""
    from pc2cad.expression.scalar import evaluate

    places = {
        name: 0.5 + 0.45 * cos(1.0 + 2.399963 * (shift * 7 + i) + 0.618034 * len(name))
        for i, name in enumerate(sorted(root.symbols))
    }
    return evaluate(root, places)
