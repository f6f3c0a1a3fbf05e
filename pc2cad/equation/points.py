"""Points and free vectors of the point calculus, with the weight that tells them apart.

A point equation is an affine combination of points: its weights sum to 1. A free vector's weights
sum to 0. Anything else (M1 + M2 has weight 2) depends on where the origin happens to be, and is
refused where a point or a vector is needed. Spec sections 1.5 and 2.1; paper section 2.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum

from pc2cad.errors import InputError
from pc2cad.expression.conditions import Condition
from pc2cad.expression.derivatives import derivatives
from pc2cad.expression.identity import is_constant_value
from pc2cad.expression.printing import as_text
from pc2cad.expression.tree import ONE, ZERO, Expr, Number, as_expr, call, substitute


class WeightsDoNotSumError(InputError):
    """The weights of a combination sum to neither 1 (a point) nor 0 (a free vector)."""


class Kind(Enum):
    """What a value of the language is."""

    SCALAR = "a scalar"
    POINT = "a point"
    VECTOR = "a free vector"


@dataclass(frozen=True, eq=False, init=False)
class Combination:
    """A linear combination of points: three coordinates and the sum of the weights."""

    x: Expr
    y: Expr
    z: Expr
    weight: Expr

    def __init__(self, x: Expr, y: Expr, z: Expr, weight: Expr) -> None:
        fields = self.__dict__  # by the way of frozen classes it takes thrice as long
        fields["x"], fields["y"], fields["z"], fields["weight"] = x, y, z, weight

    @property
    def coordinates(self) -> tuple[Expr, Expr, Expr]:
        """The coordinate-wise system (x, y, z)."""
        return self.x, self.y, self.z

    def __add__(self, other: Combination) -> Combination:
        if not isinstance(other, Combination):
            return NotImplemented
        return Combination(
            self.x + other.x, self.y + other.y, self.z + other.z, self.weight + other.weight
        )

    def __sub__(self, other: Combination) -> Combination:
        if not isinstance(other, Combination):
            return NotImplemented
        own, its = self.weight, other.weight
        weight = ZERO if own is its else own - its
        return Combination(self.x - other.x, self.y - other.y, self.z - other.z, weight)

    def __neg__(self) -> Combination:
        return Combination(-self.x, -self.y, -self.z, -self.weight)

    def __mul__(self, factor: Expr | Number) -> Combination:
        if isinstance(factor, Combination):
            return NotImplemented
        f = as_expr(factor)
        return Combination(f * self.x, f * self.y, f * self.z, f * self.weight)

    __rmul__ = __mul__

    def __truediv__(self, divisor: Expr | Number) -> Combination:
        if isinstance(divisor, Combination):
            return NotImplemented
        return self * (1 / as_expr(divisor))

    def map(self, change: Callable[[tuple[Expr, ...]], tuple[Expr, ...]]) -> Combination:
        """Return the combination with all four trees changed at once (substitution, derivative)."""
        return Combination(*change((self.x, self.y, self.z, self.weight)))

    def substitute(self, values: dict[str, Expr]) -> Combination:
        """Return the combination with symbols replaced."""
        return self.map(lambda roots: substitute(roots, values))


Value = Expr | Combination


def point(x: Expr | Number, y: Expr | Number, z: Expr | Number) -> Combination:
    """Return the point with these coordinates (model units)."""
    return Combination(as_expr(x), as_expr(y), as_expr(z), ONE)


def vector(x: Expr | Number, y: Expr | Number, z: Expr | Number) -> Combination:
    """Return the free vector with these components (model units)."""
    return Combination(as_expr(x), as_expr(y), as_expr(z), ZERO)


def kind_of(value: Value) -> Kind:
    """Return what the value is; raise WeightsDoNotSumError for what is neither point nor vector.

    What is no expression raises InputError.
    """
    if isinstance(value, Expr):
        return Kind.SCALAR
    if not isinstance(value, Combination):
        raise InputError(
            f"a point is point(x, y, z) and a free vector vector(x, y, z); {value!r:.60} is neither"
        )
    # nearly always the number itself
    weight = value.weight
    if weight is ONE or (weight is not ZERO and is_constant_value(weight, 1)):
        return Kind.POINT
    if weight is ZERO or is_constant_value(weight, 0):
        return Kind.VECTOR
    raise WeightsDoNotSumError(
        f"the weights of the points sum to {_short(weight)}; those of a point equation sum "
        "to 1 and those of a free vector to 0"
    )


def _short(weight: Expr) -> str:
    from pc2cad.expression.normal_form import normal_form

    form = normal_form(weight, largest=200)
    if form is not None and set(form) <= {()}:
        return str(form.get((), 0))
    text = as_text(weight)
    return text if len(text) <= 120 else text[:117] + "…"


def _need(value: Value, kind: Kind, role: str) -> Combination:
    found = kind_of(value)
    if found is not kind or isinstance(value, Expr):
        raise InputError(f"{role} must be {kind.value}, and {found.value} was given")
    return value


def dot(a: Value, b: Value) -> Expr:
    """Return the scalar product of two free vectors."""
    a = _need(a, Kind.VECTOR, "the first operand of dot")
    b = _need(b, Kind.VECTOR, "the second operand of dot")
    return a.x * b.x + a.y * b.y + a.z * b.z


def cross(a: Value, b: Value) -> Combination:
    """Return the vector product of two free vectors."""
    a = _need(a, Kind.VECTOR, "the first operand of cross")
    b = _need(b, Kind.VECTOR, "the second operand of cross")
    return _cross(a, b)


def _cross(a: Combination, b: Combination) -> Combination:
    return vector(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x)


def length(a: Value) -> Expr:
    """Return the length of a free vector."""
    a = _need(a, Kind.VECTOR, "the operand of length")
    return call("sqrt", a.x**2 + a.y**2 + a.z**2)


def unit(a: Value) -> Combination:
    """Return the free vector divided by its length."""
    a = _need(a, Kind.VECTOR, "the operand of unit")
    return a / length(a)


def distance(a: Value, b: Value) -> Expr:
    """Return the distance of two points."""
    first = _need(a, Kind.POINT, "the first operand of distance")
    return length(first - _need(b, Kind.POINT, "the second operand of distance"))


def det(a: Value, b: Value, c: Value) -> Expr:
    """Return the determinant (mixed product) of three free vectors."""
    third = _need(c, Kind.VECTOR, "the third operand of det")
    product = cross(a, b)
    return product.x * third.x + product.y * third.y + product.z * third.z


def metric(a: Value, b: Value, c: Value) -> Expr:
    """Return the metric operator of three points, CA·CB (the paper, Fig. 6)."""
    a, b, c = (_need(p, Kind.POINT, "an operand of metric") for p in (a, b, c))
    return dot(a - c, b - c)


def translate(a: Value, b: Value, c: Value) -> Combination:
    """Return the parallel translation of AB to C: the point C + B - A (the paper, Fig. 6)."""
    a, b, c = (_need(p, Kind.POINT, "an operand of translate") for p in (a, b, c))
    return c + b - a


def exit_from_plane(n: Value, p: Value, q: Value) -> Combination:
    """Return the exit point from the plane NPQ: N + NP × NQ (the paper, Fig. 6)."""
    n, p, q = (_need(x, Kind.POINT, "an operand of exit_from_plane") for x in (n, p, q))
    return n + _cross(p - n, q - n)


def chosen(condition: Condition, a: Value, b: Value) -> Value:
    """Return a where a condition holds, else b: both scalars, both points or both vectors."""
    kinds = kind_of(a), kind_of(b)
    if kinds[0] is not kinds[1]:
        raise InputError(
            f"if(…) chooses between values of one kind, not {kinds[0].value} and {kinds[1].value}"
        )
    if isinstance(a, Expr) or isinstance(b, Expr):
        assert isinstance(a, Expr)
        assert isinstance(b, Expr)
        return condition.choose(a, b)
    choose = condition.choose
    return Combination(choose(a.x, b.x), choose(a.y, b.y), choose(a.z, b.z), a.weight)


def rotate(p: Value, o: Value, a: Value, angle: Value | Number) -> Combination:
    """Return a point turned about the axis through o along a, right-handed (angle in radians).

    A free vector is turned about the direction a alone.
    """
    origin = _need(o, Kind.POINT, "the second operand of rotate")
    axis = unit(_need(a, Kind.VECTOR, "the third operand of rotate"))
    moved = _turned("rotate", p)
    is_point = kind_of(moved) is Kind.POINT
    arm = moved - origin if is_point else moved
    sine, cosine = _sine_and_cosine("rotate", angle)
    along = axis * (dot(axis, arm) * (1 - cosine))
    turned = arm * cosine + _cross(axis, arm) * sine + along
    return origin + turned if is_point else turned


def rotx(p: Value, angle: Value | Number) -> Combination:
    """Return a point or a vector turned about the x axis."""
    p, (s, c) = _turned("rotx", p), _sine_and_cosine("rotx", angle)
    return Combination(p.x, c * p.y - s * p.z, s * p.y + c * p.z, p.weight)


def roty(p: Value, angle: Value | Number) -> Combination:
    """Return a point or a vector turned about the y axis."""
    p, (s, c) = _turned("roty", p), _sine_and_cosine("roty", angle)
    return Combination(c * p.x + s * p.z, p.y, c * p.z - s * p.x, p.weight)


def rotz(p: Value, angle: Value | Number) -> Combination:
    """Return a point or a vector turned about the z axis."""
    p, (s, c) = _turned("rotz", p), _sine_and_cosine("rotz", angle)
    return Combination(c * p.x - s * p.y, s * p.x + c * p.y, p.z, p.weight)


def _turned(name: str, p: Value) -> Combination:
    if isinstance(p, Expr):
        raise InputError(f"{name} turns a point or a free vector, and a scalar was given")
    return p


def _sine_and_cosine(name: str, angle: Value | Number) -> tuple[Expr, Expr]:
    if isinstance(angle, Combination):
        raise InputError(f"the angle of {name} is a scalar, and {kind_of(angle).value} was given")
    tree = as_expr(angle)
    return call("sin", tree), call("cos", tree)


def derivative(value: Value, name: str, order: int = 1) -> Value:
    """Return the derivative of a scalar, point or vector; that of a point is a free vector."""
    for _ in range(order):
        if isinstance(value, Expr):
            (value,) = derivatives((value,), name)
        else:
            value = value.map(lambda roots: derivatives(roots, name))
    return value
