"""Patterns: copies of a body round an axis, along a line, or in a mirror."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from math import isfinite
from typing import TYPE_CHECKING, Final

from pc2cad.equation.language import Curves, Named, read_expression
from pc2cad.equation.points import Combination, Value, kind_of
from pc2cad.equation.syntax import CallNode, ExpressionSyntaxError
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate

if TYPE_CHECKING:
    from pc2cad.arrays import Array

#: pattern -> what its operands behind the body are: required ones, and those that go with more
PATTERNS: Final[Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "polar": (("n",), ("O", "a")),
    "linear": (("n", "step"), ()),
    "mirror": (("O", "a"), ()),
}
#: copies of one pattern
MOST_COPIES: Final = 1000
_KINDS: Final = {"n": "a scalar", "O": "a point", "a": "a free vector", "step": "a free vector"}


@dataclass(frozen=True, eq=False)
class Placement:
    """Where a copy lies: x goes to `turn` x + `offset` (3 x 3 and 3, model units)."""

    turn: Array
    offset: Array

    def after(self, first: Placement) -> Placement:
        """Return the placement that follows another one."""
        return Placement(self.turn @ first.turn, self.turn @ first.offset + self.offset)

    @property
    def mirrors(self) -> bool:
        """Whether right hands become left ones."""
        import numpy as np

        return bool(np.linalg.det(self.turn) < 0)


def write_form(kind: str) -> str:
    """Return how a pattern is written."""
    needed, more = PATTERNS[kind]
    plain = f"{kind}({', '.join(('body', *needed))})"
    return f"{plain} or {kind}({', '.join(('body', *needed, *more))})" if more else plain


def check_operands(node: CallNode) -> None:
    """Raise ExpressionSyntaxError where a pattern has not the operands that it needs."""
    needed, more = PATTERNS[node.name]
    given = len(node.operands) - 1
    if given not in (len(needed), len(needed) + len(more)):
        raise ExpressionSyntaxError(f"write {write_form(node.name)}", node.column)


def placements(
    kind: str, texts: tuple[str, ...], names: Mapping[str, Named], functions: Curves
) -> tuple[Placement, ...]:
    """Return where the copies lie, the body as it stands first; raise InputError."""
    import numpy as np

    needed, more = PATTERNS[kind]
    values: dict[str, Array] = {}
    for role, text in zip((*needed, *more), texts, strict=False):
        value = read_expression(text, names, functions)
        found = kind_of(value).value
        if found != _KINDS[role]:
            raise InputError(f"{role} of {kind} is {_KINDS[role]}, and {found} was given")
        values[role] = _numbers(value, f"{role} of {kind}")
    if kind == "mirror":
        normal, origin = _unit(values["a"], kind), values["O"]
        turn = np.eye(3) - 2 * np.outer(normal, normal)
        return Placement(np.eye(3), np.zeros(3)), Placement(turn, origin - turn @ origin)
    count = _count(values["n"], kind)
    if kind == "linear":
        return tuple(Placement(np.eye(3), k * values["step"]) for k in range(count))
    axis = _unit(values.get("a", np.array([0.0, 0.0, 1.0])), kind)
    origin = values.get("O", np.zeros(3))
    turns = (_turned(axis, k / count) for k in range(count))
    return tuple(Placement(turn, origin - turn @ origin) for turn in turns)


def _numbers(value: Value, role: str) -> Array:
    import numpy as np

    trees = value.coordinates if isinstance(value, Combination) else (value,)
    free = sorted(frozenset[str]().union(*(tree.symbols for tree in trees)))
    if free:
        raise InputError(f"{role} must be constant, and depends on {', '.join(free)}")
    found = np.array([evaluate(tree, {}) for tree in trees])
    if not all(isfinite(x) for x in found.tolist()):
        raise InputError(f"{role} is not finite")
    return found


def _count(value: Array, kind: str) -> int:
    count = float(value[0])
    if count != round(count) or not 2 <= count <= MOST_COPIES:
        raise InputError(f"n of {kind} is a whole number from 2 to {MOST_COPIES}, not {count:g}")
    return round(count)


def _unit(vector: Array, kind: str) -> Array:
    import numpy as np

    length = float(np.linalg.norm(vector))
    if not length > 0:
        raise InputError(f"a of {kind} is a direction, and the zero vector was given")
    return vector / length


def _turned(axis: Array, share: float) -> Array:
    """Return the turn about an axis by a share of a whole one (Rodrigues)."""
    import numpy as np

    quarters = share * 4
    if quarters == round(quarters):  # exact: faces of a block stay parallel to the axes
        cosine, sine = ((1.0, 0.0), (0.0, 1.0), (-1.0, 0.0), (0.0, -1.0))[round(quarters) % 4]
    else:
        cosine, sine = float(np.cos(2 * np.pi * share)), float(np.sin(2 * np.pi * share))
    x, y, z = axis
    cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    return np.asarray(cosine * np.eye(3) + sine * cross + (1 - cosine) * np.outer(axis, axis))
