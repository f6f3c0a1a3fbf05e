"""Fields: what varies over a solid beside its shape, as expressions of the same parameters.

A field is a scalar, a vector or a point in u, v, w and in x, y, z, the coordinates of the solid's
own point. Its trees keep these as symbols: the point itself is finite where M's formula is not.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Final, Literal

from pc2cad.equation.language import RESERVED_NAMES, read_expression
from pc2cad.equation.points import Combination, Kind, Value, kind_of
from pc2cad.errors import InputError
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.tree import Expr, Number, as_expr, symbol
from pc2cad.trust.names import is_identifier, visible

#: the coordinates of the solid's point, as fields name them
COORDINATES: Final = ("x", "y", "z")
#: what may stay free in a field
SYMBOLS: Final = (*PARAMETERS, *COORDINATES)
#: columns that files have beside fields
_TAKEN: Final = (*SYMBOLS, "side", "layer")
#: the field that weighs the solid
DENSITY: Final = "density"
#: what the name of a field begins with that says how places move with a parameter
VELOCITY: Final = "velocity_"
MOST_FIELDS: Final = 200

FieldKind = Literal["scalar", "vector", "point"]
#: what may define a field in Python: text, an expression, a vector or point, or three coordinates
FieldValue = str | Value | Number | Sequence[Expr | Number]


class FieldError(InputError):
    """A field has a name or a value that fields do not have."""


def check_field_name(name: str) -> None:
    """Raise FieldError unless a field may have this name.

    Names go into files of a dozen formats, and may come from strangers.
    """
    if not isinstance(name, str) or not is_identifier(name):
        raise FieldError(
            f"'{visible(str(name))[:80]}' is not the name of a field (a letter, then letters, "
            "digits, _, 64 characters at most)"
        )
    if name.lower() in _TAKEN or name in RESERVED_NAMES:
        raise FieldError(f"the name {name} is reserved: a field needs another one")


@dataclass(frozen=True)
class Field:
    """A named value at every place of a solid."""

    name: str
    kind: FieldKind
    #: one tree, or three; their symbols are u, v, w, x, y and z
    components: tuple[Expr, ...]

    def __post_init__(self) -> None:
        check_field_name(self.name)
        if len(self.components) != (1 if self.kind == "scalar" else 3):
            raise FieldError(f"the field {self.name} has {len(self.components)} components")
        strange = set().union(*(tree.symbols for tree in self.components)) - set(SYMBOLS)
        if strange:
            raise FieldError(
                f"the field {self.name} depends on {sorted(strange)[0]:.80}; only u, v, w and "
                "x, y, z may stay free"
            )

    @property
    def labels(self) -> tuple[str, ...]:
        """A name for each component: ``flow.x``, or the field's own where there is one."""
        if self.kind == "scalar":
            return (self.name,)
        return tuple(f"{self.name}.{axis}" for axis in COORDINATES)


def make_field(name: str, value: FieldValue) -> Field:
    """Return a field from what Python gives for it; raise FieldError or InputError."""
    if isinstance(value, str):
        value = read_expression(value, {s: symbol(s) for s in SYMBOLS})
    if isinstance(value, Combination):
        kind: FieldKind = "point" if kind_of(value) is Kind.POINT else "vector"
        return Field(name, kind, value.coordinates)
    if isinstance(value, Sequence):
        if len(value) != 3:
            raise FieldError(f"the field {name} has {len(value)} components instead of 1 or 3")
        return Field(name, "vector", tuple(_scalar(name, x) for x in value))
    return Field(name, "scalar", (_scalar(name, value),))


def _scalar(name: str, value: object) -> Expr:
    if isinstance(value, bool) or not isinstance(value, (Expr, int, float, Fraction)):
        raise FieldError(
            f"the field {name} is made of {value!r:.80}; it is a text, an expression, a vector or "
            "a point"
        )
    return as_expr(value)


def checked_fields(fields: Sequence[Field]) -> Mapping[str, Field]:
    """Return fields by their names, which differ in more than capitals; raise FieldError."""
    found: dict[str, Field] = {}
    seen: set[str] = set()
    if len(fields) > MOST_FIELDS:
        raise FieldError(f"there are {len(fields)} fields, and at most {MOST_FIELDS} are taken")
    for field in fields:
        if field.name.lower() in seen:
            raise FieldError(f"two fields are called {field.name}, but for capitals")
        seen.add(field.name.lower())
        found[field.name] = field
    return found
