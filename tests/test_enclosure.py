"""Taylor models hold every value; bounds of deviations hold every sample, and what samples miss."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from pc2cad.bounds.cells import conversion_loss, halving, to_bernstein
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import Place
from pc2cad.expression.evaluation import Program
from pc2cad.expression.linear_terms import cancel_terms
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import Expr, ValueDomainError, call, number, pieces, power, symbol, walk
from pc2cad.geometry.splines.bernstein import chebyshev_nodes

Array = NDArray[np.float64]
U, V = symbol("u"), symbol("v")
mpmath.mp.dps = 40

SMOOTH = ("sin", "cos", "tan", "exp", "log", "sqrt", "sinh", "cosh", "tanh", "asin", "acos",
          "atan", "asinh", "acosh", "atanh")  # fmt: skip


def exact(roots: tuple[Expr, ...], **places: object) -> list[mpmath.mpc]:
    """Evaluate trees with 40 digits, for complex parameters as well."""
    store: dict[Expr, mpmath.mpc] = {}
    for node in walk(roots):
        args = [store[arg] for arg in node.args]
        store[node] = _value(node, args, places)
    return [store[root] for root in roots]


def _value(node: Expr, args: list[mpmath.mpc], places: dict[str, object]) -> mpmath.mpc:
    op, payload = node.op, node.payload
    if op == "number":
        return mpmath.mpf(payload.numerator) / payload.denominator
    if op == "constant":
        return mpmath.pi() if payload == "pi" else mpmath.e()
    if op == "symbol":
        return mpmath.mpmathify(places[payload])
    if op == "pow":
        return mpmath.power(*args)
    if op == "abs":
        return args[0] if mpmath.re(args[0]) > 0 else -args[0]
    if op == "atan2":
        y, x = args
        if mpmath.re(x) > 0:
            return mpmath.atan(y / x)
        return mpmath.sign(mpmath.re(y)) * mpmath.pi() / 2 - mpmath.atan(x / y)
    if op in ("add", "mul", "div", "neg"):
        a, b = (*args, None)[:2]
        return {"add": lambda: a + b, "mul": lambda: a * b, "div": lambda: a / b,
                "neg": lambda: -a}[op]()  # fmt: skip
    return getattr(mpmath, op)(*args)


def _grow(inner: st.SearchStrategy[Expr]) -> st.SearchStrategy[Expr]:
    return st.one_of(
        st.tuples(inner, inner).map(lambda p: p[0] + p[1]),
        st.tuples(inner, inner).map(lambda p: p[0] - p[1]),
        st.tuples(inner, inner).map(lambda p: p[0] * p[1]),
        st.tuples(inner, inner).map(lambda p: p[0] / (2 + p[1] * p[1])),
        st.tuples(inner, inner).map(lambda p: p[0] / p[1]),
        st.tuples(st.sampled_from(SMOOTH), inner).map(lambda p: call(p[0], p[1])),
        st.tuples(inner, st.sampled_from([2, 3, -1, 9, -2, Fraction(5, 3), Fraction(-1, 2)])).map(
            lambda p: power(p[0], number(p[1]))
        ),
        st.tuples(inner, inner).map(lambda p: call("atan2", p[0], p[1])),
        inner.map(lambda x: call("abs", x)),
    )


LEAVES = st.one_of(
    st.sampled_from([U, V]),
    st.fractions(min_value=-3, max_value=3, max_denominator=9).map(number),
)


@st.composite
def trees(draw: st.DrawFn) -> Expr:
    """Draw a random tree in u and v."""
    stack = [draw(LEAVES) for _ in range(2)]
    for _ in range(draw(st.integers(2, 7))):
        try:
            stack.append(draw(_grow(st.sampled_from(stack))))
        except (ValueDomainError, ZeroDivisionError):
            continue
    return stack[-1]


def _box(middle: float, half: float, wide: float) -> Place:
    return Place(np.array([middle]), np.array([half]), np.array([half * wide]))


def _inside(place: Place, z: complex) -> mpmath.mpc:
    return mpmath.mpf(place.centre[0]) + mpmath.mpf(place.radius[0]) * mpmath.mpmathify(z)


@pytest.mark.slow
@settings(max_examples=150, deadline=None, suppress_health_check=list(HealthCheck))
@given(
    trees(), st.floats(0.1, 0.9), st.floats(0.1, 0.9), st.sampled_from([0.001, 0.02, 0.1]),
    st.sampled_from([0, 2, 6]), st.integers(0, 2**32 - 1),
)  # fmt: skip
def test_models_hold_complex_values_and_errors_hold_computed_ones(
    tree: Expr, u: float, v: float, half: float, order: int, seed: int
) -> None:
    places = (_box(u, half, 3.0), _box(v, half, 3.0))
    (model,) = enclose((tree,), ("u", "v"), places, order)
    radius = float(np.broadcast_to(model.radius, (1, 1))[0, 0])
    assume(np.isfinite(radius))
    rng = np.random.default_rng(seed)
    sides = np.sqrt(rng.uniform(0, 1, (6, 2))) * np.exp(2j * np.pi * rng.uniform(0, 1, (6, 2)))
    for s, t in (*sides, (1, -1), (1j, 1j), (0, 0)):
        (value,) = exact((tree,), u=_inside(places[0], s), v=_inside(places[1], t))
        terms = model.terms[:, :, 0, 0]
        polynomial = sum(
            float(terms[i, j]) * mpmath.mpmathify(s) ** i * mpmath.mpmathify(t) ** j
            for i, j in np.ndindex(*terms.shape)
        )
        assert abs(value - polynomial) <= radius * (1 + 1e-12)
    x, y = u + half * rng.uniform(-1, 1, 8), v + half * rng.uniform(-1, 1, 8)
    (computed,) = Program((tree,))({"u": x, "v": y})
    error = float(np.broadcast_to(model.error, (1, 1))[0, 0])
    for k, value in enumerate(np.broadcast_to(computed, 8)):
        (truth,) = exact((tree,), u=float(x[k]), v=float(y[k]))
        assert abs(float(value) - truth) <= error


@pytest.mark.parametrize("name", SMOOTH)
def test_every_function_is_enclosed_at_all_orders(name: str) -> None:
    argument = U + Fraction(3, 2) if name == "acosh" else U * Fraction(7, 8)
    tree = call(name, argument)
    for order in range(8):
        (model,) = enclose((tree,), ("u",), (_box(0.5, 0.02, 4.0),), order)
        assert np.isfinite(model.radius).all()
        for z in np.exp(2j * np.pi * np.arange(12) / 12):
            (value,) = exact((tree,), u=_inside(_box(0.5, 0.02, 4.0), z))
            polynomial = sum(float(c) * z**i for i, c in enumerate(model.terms[:, 0, 0, 0]))
            assert abs(value - polynomial) <= model.radius[0, 0] * (1 + 1e-12)
        # a disc of a sixth of the way to the nearest singularity gains a factor at each order
        assert model.radius[0, 0] <= 4.0 * 0.55 ** (order + 1)


def test_nothing_is_claimed_beyond_a_singularity() -> None:
    for tree in (1 / U, call("sqrt", U), call("log", U), call("abs", U), call("atan2", V, U - 2)):
        models = enclose((tree,), ("u", "v"), (_box(0.1, 0.05, 2.1), _box(0.05, 0.02, 3)), 6)
        assert np.isinf(models[0].radius).all(), tree


def test_pieces_are_continued_within_their_own_cells_only() -> None:
    wave = pieces(U, (Fraction(0), Fraction(1, 2), Fraction(1)),
                  ((number(0), number(1)), (number(1), number(-3))), 0)  # fmt: skip
    cells = Place(np.array([0.25, 0.75, 0.5]), np.full(3, 0.25), np.full(3, 0.75))
    (model,) = enclose((wave,), ("u",), (cells,), 3)
    assert (model.radius[:2] < 1e-12).all()
    assert np.isinf(model.radius[2])
    assert model.terms[:2, 0, :2, 0] == pytest.approx(np.array([[0.25, 0.25], [0.75, -2.25]]))


def test_terms_that_cancel_are_taken_out() -> None:
    n = call("sin", U) + U**3 + 2
    tree = (n + 5 * V) - n + (n - U**3)
    (short,) = cancel_terms((tree,))
    assert len(list(walk((short,)))) < len(list(walk((tree,))))
    for u in (0.2, 0.9):
        at = {"u": u, "v": 0.3}
        assert evaluate(short, at) == pytest.approx(evaluate(tree, at), rel=1e-14)
    (zero,) = cancel_terms((n - (U**3 + 2) - call("sin", U),))
    assert zero is number(0)


@pytest.mark.parametrize("degree", [0, 1, 4, 7, 9, 15])
def test_coefficients_give_back_the_values(degree: int) -> None:
    nodes = chebyshev_nodes(degree)
    values = np.random.default_rng(degree).uniform(-1, 1, degree + 1)
    coefficients = to_bernstein(degree) @ values
    work = np.repeat(coefficients[None], degree + 1, axis=0)
    for k in range(degree):
        work = (1 - nodes[:, None]) * work[:, : degree - k] + nodes[:, None] * work[
            :, 1 : degree - k + 1
        ]
    gap = np.abs(work[:, 0] - values).max()
    assert gap <= conversion_loss(degree, 0) < 1e-7
    left, right = (halving(degree)[k] @ coefficients for k in (0, -1))
    assert (left[0], right[-1]) == (coefficients[0], coefficients[-1])
    assert left[-1] == pytest.approx(right[0], abs=1e-9)
