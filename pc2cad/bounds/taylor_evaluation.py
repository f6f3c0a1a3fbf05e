"""Taylor models of expression trees, each common sub-tree taken once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import lru_cache
from typing import Final

import numpy as np

from pc2cad.arrays import Array, Integers
from pc2cad.arrays.distinct import distinct
from pc2cad.bounds.fixed_numbers import UNKNOWN, fixed, rounded
from pc2cad.bounds.known import Known, Models, Store
from pc2cad.bounds.taylor_functions import (
    FUNCTIONS,
    SEVERAL,
    inverse,
    inverse_root,
    power,
    real_power,
    whole_power,
)
from pc2cad.bounds.taylor_models import (
    UNIT,
    Model,
    Place,
    add,
    beside,
    constant,
    known,
    mul,
    neg,
    pad,
    parameter,
    parts,
    shift,
)
from pc2cad.bounds.taylor_waves import model_of
from pc2cad.expression.carried import earlier_trees
from pc2cad.expression.tree import Expr, number, walk

#: boxes of a model up to which it is taken beside others: of more it costs what work on them costs
MOST_BESIDE: Final = 256
_TWO: Final = number(2)

#: nodes, and what models are needed of for each
_Level = list[tuple[Expr, tuple[Expr, ...]]]


def enclose(
    roots: Sequence[Expr],
    names: Sequence[str],
    places: Sequence[Place],
    order: int,
    known_models: Known | None = None,
) -> tuple[Model, ...]:
    """Return models of the trees over the places of one or two parameters.

    These are the product of places with one entry per box, or what places (n, m) broadcast to.
    `order` is the degree of their polynomials, at least 1: that of a parameter itself.
    Where a function is not analytic, or could not be shown to be, the radius is infinite.
    """
    order = max(order, 1)
    where = dict(zip(names, places, strict=True))
    models = (known_models or Known()).at(names, places, order)
    found: Store = {}
    levels = _levels(tuple(roots), models, found)
    fresh: Store = {}
    with np.errstate(all="ignore"):
        for level in levels:
            for node, operands in _without_products(level, found, fresh, order):
                args = tuple([found[arg] for arg in operands])
                if node.op == "neg" and args:
                    model = neg(args[0])
                elif node.op == "symbol":
                    axis = names.index(node.payload)
                    model = parameter(places[axis], axis)
                else:
                    model = known(_step(node, args, where, order))
                found[node] = fresh[node] = model
    models.store(fresh)
    if models.places:
        below = dict([step for level in levels for step in level])
        models.carry(roots, found, list(fresh), below.__getitem__)
    return tuple([found[root] for root in roots])


def _levels(roots: tuple[Expr, ...], models: Models, found: Store) -> list[_Level]:
    """Return nodes without models: each needs none of its own level, nor of later ones.

    Models that there are of the nodes below these become `found`.
    """
    earlier = earlier_trees()
    # all that is asked for has the one parameter, or none
    stored = next(iter(models.alone.values())).get if len(models.alone) == 1 else models.stored
    needed: dict[Expr, tuple[Expr, ...]] = {}

    def below(node: Expr) -> tuple[Expr, ...]:
        model = stored(node)
        if model is None and node in earlier:
            model = models.carried(node)
        if model is None:
            needed[node] = operands = _operands(node)
            return operands
        found[node] = model
        return ()

    levels: list[_Level] = []
    depth: dict[Expr, int] = {}
    for node in walk(roots, below):
        if node in found:
            continue
        operands, level = needed[node], 0
        for arg in operands:
            over = depth.get(arg, -1) + 1
            if over > level:
                level = over
        depth[node] = level
        if level == len(levels):
            levels.append([])
        levels[level].append((node, operands))
    return levels


def _without_products(level: _Level, found: Store, fresh: Store, order: int) -> _Level:
    """Find those products of a level that are of one shape, at once; return what is left of it.

    Models of few boxes cost what their calls cost, and boxes have nothing to do with one another:
    those of several models may as well be those of one.
    """
    if len(level) < 2:
        return level
    alike: dict[tuple[int, ...], list[tuple[Expr, Model, Model]]] = {}
    left: _Level = []
    for step in level:
        node, operands = step
        if not node.symbols:
            left.append(step)
            continue
        if node.op == "mul":
            x, y = found[operands[0]], found[operands[1]]
        elif node.op == "pow" and node.args[1] is _TWO:
            x = y = found[operands[0]]
        else:
            left.append(step)
            continue
        shape, boxes = x.terms.shape, x.radius.shape
        if (
            1 < x.radius.size <= MOST_BESIDE
            and shape[2:] == boxes
            and (boxes == y.terms.shape[2:] == y.radius.shape == x.error.shape == y.error.shape)
        ):
            alike.setdefault(shape + y.terms.shape[:2], []).append((node, x, y))
        else:
            left.append(step)
    for rows in alike.values():
        nodes, first, second = zip(*rows, strict=True)
        if len(nodes) == 1:
            left.append((nodes[0], _operands(nodes[0])))
            continue
        one = beside(first)
        other = one if first == second else beside(second)  # as of squares
        whole = known(mul(one, other, order))
        new = dict(zip(nodes, parts(whole, len(nodes)), strict=True))
        found |= new
        fresh |= new
    return left


def _operands(node: Expr) -> tuple[Expr, ...]:
    """Return what models are needed of: no coefficients that are numbers, no roots divided by.

    Nor of what a number is worked out from that holds no symbol.
    """
    if not node.symbols and fixed(node) is not UNKNOWN:
        return ()
    if node.op == "div" and node.args[1].op == "sqrt":
        return node.args[0], node.args[1].args[0]
    table = node.op == "pieces" and _table(node) is not None
    return node.args[:1] if table else node.args


def _step(node: Expr, args: tuple[Model, ...], where: Mapping[str, Place], order: int) -> Model:
    op = node.op
    if not args:
        return _number(node)
    if op == "add":
        return add(args[0], args[1])
    if op == "neg":
        return neg(args[0])
    if op == "div" and node.args[1].op == "sqrt":
        # one power: as a root and its inverse it would be composed twice
        return mul(args[0], inverse_root(args[1], order), order)
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


@lru_cache(maxsize=1024)
def _number(node: Expr) -> Model:
    return constant(*fixed(node))


@lru_cache(maxsize=256)
def _table(node: Expr) -> Array | None:
    """Return what `rounded` gives of the coefficients of pieces, (2, pieces, width).

    None where some of them are no numbers.
    """
    flat = node.args[1:]
    if any(c.op != "number" for c in flat):
        return None
    return np.array([rounded(c.payload) for c in flat]).T.reshape(2, -1, node.payload.width)


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
        place = where[name].spread(0 if argument.terms.shape[0] > 1 else 1)
        half = argument.reach * (place.half / place.radius)
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
    value: Model | None = None
    table = _table(node)
    for k in reversed(range(width)):
        if table is None:
            coefficient = _chosen(flat[k::width], index)
        else:
            terms, off = table[:, index, k]
            coefficient = Model(terms[None, None], off, off)
        value = coefficient if value is None else add(mul(value, local, order), coefficient)
    assert value is not None
    return value


def _chosen(column: tuple[Model, ...], index: Integers) -> Model:
    """Return, box by box, one of several models."""
    numbers = distinct(index).tolist()
    i, j = (max(column[k].terms.shape[axis] for k in numbers) for axis in range(2))
    first = column[numbers[0]]
    terms, radius, error = pad(first.terms, (i, j)), first.radius, first.error
    for k in numbers[1:]:
        here, model = index == k, column[k]
        terms = np.where(here, pad(model.terms, (i, j)), terms)
        radius = np.where(here, model.radius, radius)
        error = np.where(here, model.error, error)
    return Model(terms, radius, error)
