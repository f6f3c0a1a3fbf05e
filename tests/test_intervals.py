"""Interval enclosures hold every value: compared with 60 digits, at places inside the box."""

from __future__ import annotations

from fractions import Fraction

import mpmath
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pc2cad.expression.enclosures import ENCLOSURES, IntervalProgram
from pc2cad.expression.intervals import Interval, enclosed_number, interval
from pc2cad.expression.tree import PI, E, Expr, call, number, piece_rows, pieces, symbol, walk

X, Y = symbol("x"), symbol("y")
many = settings(max_examples=300, deadline=None, derandomize=True)
floats = st.floats(-1e3, 1e3, allow_nan=False) | st.floats(-3, 3) | st.sampled_from(
    [0.0, 1.0, -1.0, np.pi, -np.pi, np.pi / 2, 1e-300, -1e-300, 1e-8]
)  # fmt: skip
inside = st.floats(0, 1)

MP = {
    **{n: getattr(mpmath, n) for n in ("sin", "cos", "tan", "asin", "acos", "atan", "sinh")},
    **{n: getattr(mpmath, n) for n in ("cosh", "tanh", "asinh", "acosh", "atanh", "exp", "log")},
    "floor": mpmath.floor, "min": min, "max": max,
    "mod": lambda a, m: a - m * mpmath.floor(a / m), "where": lambda g, a, b: a if g >= 0 else b,
    "sqrt": mpmath.sqrt, "abs": abs, "sign": mpmath.sign, "atan2": mpmath.atan2,
}  # fmt: skip


def truth(root: Expr, places: dict[str, float]):
    """The value with 60 digits; None where the tree has none."""
    store = {}
    for node in walk((root,)):
        args = [store[a] for a in node.args]
        if any(a is None for a in args):
            return None
        try:
            store[node] = exact(node, args, places)
        except ZeroDivisionError:
            return None
        if not mpmath.isfinite(store[node]) or mpmath.im(store[node]) != 0:
            return None
    return store[root]


def exact(node, args, places):
    if node.op == "number":
        return mpmath.mpf(node.payload.numerator) / node.payload.denominator
    if node.op == "constant":
        return mpmath.pi if node.payload == "pi" else mpmath.e
    if node.op == "symbol":
        return mpmath.mpf(places[node.payload])
    if node.op == "pieces":
        breaks = [mpmath.mpf(b.numerator) / b.denominator for b in node.payload[0]]
        t = args[0]
        if node.payload.closed:
            t = (t - breaks[0]) % (breaks[-1] - breaks[0]) + breaks[0]
        i = max((i for i in range(len(breaks) - 1) if breaks[i] <= t), default=0)
        row = [exact(c, [], {}) for c in piece_rows(node)[i]]
        return sum(c * (t - breaks[i]) ** k for k, c in enumerate(row))
    simple = {
        "add": lambda a, b: a + b, "mul": lambda a, b: a * b, "div": lambda a, b: a / b,
        "neg": lambda a: -a, "pow": lambda a, b: a**b,
    }  # fmt: skip
    return (simple.get(node.op) or MP[node.op])(*args)


def holds(root: Expr, boxes: dict[str, tuple[float, float]], shares: dict[str, float]) -> None:
    program = IntervalProgram((root,))
    (found,) = program({k: interval(*box) for k, box in boxes.items()})
    assert not np.isnan(found.lower)
    assert not np.isnan(found.upper)
    assert found.lower <= found.upper
    for share in (*shares.items(),):
        assert 0 <= share[1] <= 1
    places = {k: min(max(a + (b - a) * shares[k], a), b) for k, (a, b) in boxes.items()}
    with mpmath.workdps(60):
        value = truth(root, places)
        if value is not None:
            assert mpmath.mpf(float(found.lower)) <= value <= mpmath.mpf(float(found.upper))


@many
@given(name=st.sampled_from(sorted(ENCLOSURES)), a=floats, b=floats, share=inside)
def test_every_function_holds_its_values(name, a, b, share):
    holds(call(name, X), {"x": (min(a, b), max(a, b))}, {"x": share})


@many
@given(name=st.sampled_from(["sin", "cos", "tan"]), a=st.floats(-1e7, 1e7), width=st.floats(0, 7),
       share=inside)  # fmt: skip
def test_large_turns_hold(name, a, width, share):
    holds(call(name, X), {"x": (a, a + width)}, {"x": share})


TREES = [
    X + Y, X - Y, X * Y, X / Y, X**2, X**3, X**-1, X**-2, X**12, X**13, abs(X) ** Y, Y**X,
    abs(X) ** number(Fraction(1, 3)), X ** number(Fraction(-3, 2)), call("atan2", X, Y),
    call("atan2", -X, Y) * call("exp", -(Y**2)), call("sqrt", 1 - X**2) * PI + E / (1 + Y**2),
    call("sin", PI * X) * call("cos", 2 * PI * Y), X * (1 - X) / call("sqrt", X**2 + Y**2),
    call("min", X, Y * 2) - call("max", X**2, Y), call("mod", X, number(Fraction(1, 3))),
    call("mod", X * Y, number(7)) * call("floor", X), call("where", X - Y, X * Y, call("sin", Y)),
]  # fmt: skip


@many
@given(root=st.sampled_from(TREES), a=floats, b=floats, c=floats, d=floats, s=inside, t=inside)
def test_compound_trees_hold(root, a, b, c, d, s, t):
    boxes = {"x": (min(a, b), max(a, b)), "y": (min(c, d), max(c, d))}
    holds(root, {k: v for k, v in boxes.items() if k in root.symbols}, {"x": s, "y": t})


PIECES, OPEN_PIECES = (
    pieces(
        X, tuple(map(Fraction, (1, 2, 4, 5))),
        tuple(tuple(number(c) for c in row) for row in ((1, 2, -3), (0, 5, -1), (6, 1, -6))),
        0, closed,
    ) for closed in (True, False)
)  # fmt: skip


@many
@given(
    root=st.sampled_from([PIECES, OPEN_PIECES]),
    a=st.floats(-20, 20),
    width=st.floats(0, 9) | st.sampled_from([0.0, 1.0, 4.0]),
    share=inside,
)
def test_pieces_hold(root, a, width, share):
    holds(root, {"x": (a, a + width)}, {"x": share})


OPEN = pieces(X, *PIECES.payload[:1], piece_rows(PIECES), 0, closed=False)


@many
@given(a=st.floats(-3, 9), width=st.floats(0, 9) | st.sampled_from([0.0, 1.0, 4.0]), share=inside)
def test_open_pieces_hold(a, width, share):
    holds(OPEN, {"x": (a, a + width)}, {"x": share})


@many
@given(value=st.fractions(max_denominator=10**9))
def test_numbers_hold(value):
    found = enclosed_number(value)
    assert Fraction(float(found.lower)) <= value <= Fraction(float(found.upper))


def test_divisions_by_an_interval_round_zero_know_nothing_and_are_no_nan():
    (found,) = IntervalProgram((X / Y,))({"x": interval(0.0), "y": interval([-1, 0, 0], [1, 1, 0])})
    assert not np.isnan(found.lower).any()
    assert found.upper.max() <= np.inf
    (found,) = IntervalProgram((1 / Y,))({"y": interval([-1.0, 0.0, 0.0, -2.0], [1.0, 2, 0, 0])})
    assert list(found.lower) == [-np.inf, pytest.approx(0.5), -np.inf, -np.inf]
    assert list(found.upper) == [np.inf, np.inf, np.inf, pytest.approx(-0.5)]


def test_positive_stays_positive():
    box = interval(0.0, 1.0)
    for root in (X * X, X**3, call("sqrt", X), call("sin", PI * X / 4), X * call("exp", -(X**2))):
        (found,) = IntervalProgram((root,))({"x": box})
        assert found.lower >= 0


def test_enclosures_are_tight_to_rounding_on_boxes_of_no_length():
    places = np.linspace(0.05, 0.95, 40)
    roots = tuple(call(n, X) if n != "acosh" else call(n, 2 + X) for n in ENCLOSURES)
    results = IntervalProgram(roots)({"x": interval(places)})
    assert len(results) == len(ENCLOSURES) >= 17
    for found in results:
        assert (found.upper - found.lower <= 1e-14 * (1 + np.abs(found.middle))).all()


def test_open_grids_are_factored():
    grid = {"x": interval(np.zeros((5, 1)), np.ones((5, 1))), "y": interval(np.ones((1, 7)))}
    first, both = IntervalProgram((call("sin", X), X * Y))(grid)
    assert isinstance(first, Interval)
    assert first.lower.shape == (5, 1)
    assert both.upper.shape == (5, 7)
