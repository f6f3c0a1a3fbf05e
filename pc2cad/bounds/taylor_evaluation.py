"""Taylor models of expression trees, each common sub-tree taken once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.bounds.cells import Cells
from pc2cad.bounds.taylor_functions import (
    FUNCTIONS,
    SEVERAL,
    inverse,
    power,
    real_power,
    whole_power,
)
from pc2cad.bounds.taylor_models import (
    UNIT,
    Model,
    Place,
    add,
    constant,
    known,
    mul,
    neg,
    parameter,
    shift,
)
from pc2cad.bounds.taylor_waves import model_of
from pc2cad.expression.tree import Expr, walk


class Known:
    """Models by the places that they hold for: the faces and edges of a part share many."""

    def __init__(self) -> None:
        self._stores: dict[tuple[object, ...], dict[Expr, Model]] = {}
        #: cells by a parameter's name and the cells first tried: what is hard for one function of
        #: a parameter is hard for its others
        self.finer: dict[tuple[str, int, bytes], Cells] = {}

    def at(self, names: Sequence[str], places: Sequence[Place], order: int) -> dict[Expr, Model]:
        """Return the models known for the product of some places, to be added to."""
        if len(names) > 1:
            # these are many, and hardly ever asked for again
            return {}
        arrays = (x.tobytes() for place in places for x in (place.centre, place.half, place.radius))
        errors = (place.error for place in places)
        return self._stores.setdefault((order, *names, *arrays, *errors), {})


def enclose(
    roots: Sequence[Expr],
    names: Sequence[str],
    places: Sequence[Place],
    order: int,
    known_models: Known | None = None,
) -> tuple[Model, ...]:
    """Return models of the trees over the product of the places of one or two parameters.

    `order` is the degree of their polynomials, at least 1: that of a parameter itself.
    Where a function is not analytic, or could not be shown to be, the radius is infinite.
    """
    order = max(order, 1)
    where = dict(zip(names, places, strict=True))
    store = (known_models or Known()).at(names, places, order)
    with np.errstate(all="ignore"):
        for node in walk(tuple(roots), lambda n: () if n in store else n.args):
            if node in store:
                continue
            if node.op == "symbol":
                axis = names.index(node.payload)
                store[node] = parameter(places[axis], axis)
            else:
                args = tuple(store[arg] for arg in node.args)
                store[node] = known(_step(node, args, where, order))
    return tuple(store[root] for root in roots)


def _step(node: Expr, args: tuple[Model, ...], where: Mapping[str, Place], order: int) -> Model:
    op = node.op
    if op == "number":
        value = float(node.payload)
        return constant(value, 0.0 if value == node.payload else UNIT * abs(value))
    if op == "constant":
        value = float(np.pi if node.payload == "pi" else np.e)
        return constant(value, UNIT * value)
    if op == "add":
        return add(args[0], args[1])
    if op == "neg":
        return neg(args[0])
    if op in SEVERAL:
        return SEVERAL[op](*args, order)
    if op == "within":
        return args[0]
    if op == "pow":
        return _power(node, args, order)
    if op == "pieces":
        return _pieces(node, args, where, order)
    if op == "fourier":
        return model_of(node.payload, args[0], args[1], order)
    return FUNCTIONS[op](args[0], order)


def _power(node: Expr, args: tuple[Model, ...], order: int) -> Model:
    exponent = node.args[1]
    if exponent.op != "number":
        return power(args[0], args[1], order)
    value = exponent.payload
    if value.denominator != 1:
        return real_power(args[0], float(value), order)
    if value > 0:
        return whole_power(args[0], int(value), order)
    model = inverse(whole_power(args[0], -int(value), order), order)
    return Model(model.terms, model.radius, model.error + 8 * UNIT * model.largest)


def _pieces(node: Expr, args: tuple[Model, ...], where: Mapping[str, Place], order: int) -> Model:
    """Return the piece in which the real cell lies, continued to the disc."""
    breaks, width, _, closed = node.payload
    argument, flat = args[0], args[1:]
    knots = np.array([float(b) for b in breaks])
    period = knots[-1] - knots[0]
    middle = argument.centre
    half = np.zeros_like(middle)
    for name in node.args[0].symbols:
        # one parameter at most, and the argument is affine in it
        place = where[name]
        shape = (-1, 1) if argument.terms.shape[0] > 1 else (1, -1)
        half = argument.reach * (place.half / place.radius).reshape(shape)
    turn = np.floor((middle - knots[0]) / period) if closed else np.zeros_like(middle)
    index = np.clip(
        np.searchsorted(knots, middle - turn * period, side="right") - 1, 0, len(knots) - 2
    )
    start, end = knots[index] + turn * period, knots[index + 1] + turn * period
    # a cell that overlaps the next piece by rounding: as if its parameter were off by that much
    below, above = start - (middle - half), middle + half - end
    if not closed:
        below = np.where(index == 0, 0.0, below)
        above = np.where(index == len(knots) - 2, 0.0, above)
    overlap = np.maximum(np.maximum(below, above), 0.0)
    overlap = np.where(overlap <= 1e-9 * (end - start), overlap, np.inf)
    size = (np.abs(middle) + period + np.abs(knots).max()) * 8 * UNIT
    local = shift(argument, -start)
    local = Model(local.terms, local.radius + size, local.error + overlap + size)
    value = constant(0.0)
    for k in reversed(range(width)):
        value = add(mul(value, local, order), _chosen(flat[k::width], index))
    return value


def _chosen(column: tuple[Model, ...], index: Integers) -> Model:
    """Return, box by box, one of several models."""
    i, j = (max(model.terms.shape[axis] for model in column) for axis in range(2))
    terms: Array | None = None
    radius = error = np.zeros((1, 1))
    for k, model in enumerate(column):
        here = index == k
        wide = np.zeros((i, j, *model.terms.shape[2:]))
        wide[: model.terms.shape[0], : model.terms.shape[1]] = model.terms
        terms = wide if terms is None else np.where(here, wide, terms)
        radius = model.radius if k == 0 else np.where(here, model.radius, radius)
        error = model.error if k == 0 else np.where(here, model.error, error)
    assert terms is not None
    return Model(terms, radius, error)
