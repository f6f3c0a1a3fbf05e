"""Triple products of long vectors of one parameter, from models of the vectors themselves.

A derivative needs no models of its own: what is within ρ of a polynomial on a disc of radius R has,
within r of the disc's middle, a derivative within ρ/(R - r) of the polynomial's, by Cauchy. So
models are taken on discs that are wider than the boxes, and those of all vectors are multiplied as
one.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache

import numpy as np

from pc2cad.arrays import Array
from pc2cad.bounds.known import Known, Models
from pc2cad.bounds.taylor_evaluation import enclose
from pc2cad.bounds.taylor_models import SLACK, TINY, UNIT, Model, Place, add, mul, neg
from pc2cad.expression.tree import ONE
from pc2cad.solidity.jacobian_proof.triples import Scaled

#: discs of models are so many times as wide as boxes, and models of this order
WIDER, ORDER = 2.0, 5
#: coordinates whose products make those of a × b, less the products of the last three
_ONE, _OTHER = [1, 2, 0, 2, 0, 1], [2, 0, 1, 1, 2, 0]
#: middles and half widths of ranges
Ranges = tuple[Array, Array]


def ranges_of_triples(
    rows: Sequence[Scaled], triples: Sequence[tuple[int, int, int]], name: str, place: Place,
    known: Known,
) -> tuple[Array, Array, Models]:  # fmt: skip
    """Return middles and half widths of det(A_k', A_i, A_j), (triples (k, i, j), boxes).

    In each box all are times one positive number: half its length, and what all have in common.
    With them come the models that were taken.
    """
    wide = Place(place.centre, place.half, WIDER * place.half, place.error)
    # vectors and, where their lengths are not outside of the derivative, with these
    vectors = [row.vector for row in rows]
    derived: list[int] = []
    for k, *pair in triples:
        alone = k in pair or rows[k].length is ONE
        derived.append(k if alone else len(vectors))
        vectors += [] if alone else [tuple([rows[k].length * x for x in rows[k].vector])]
    roots = [*sum(vectors, ()), *(row.length for row in rows)]
    models = enclose(roots, (name,), (wide,), ORDER, known)
    count, boxes = 3 * len(vectors), len(place.centre)
    with np.errstate(all="ignore"):  # what is not bounded is nan
        at, i, j = (list(row) for row in zip(*triples, strict=True))
        products = _products(_stacked(models[:count], 3, boxes), derived, i, j)
        own = _narrow(_stacked(models[count:], 1, boxes))
        middle, off = own.centre[:, 0], own.reach[:, 0]
        # that of the vector derived where it is one of the others too
        inner = np.array([[x in pair] for x, *pair in triples])
        found = _times(products, (np.where(inner, middle[at], 1.0), np.where(inner, off[at], 0.0)))
        if len({pair[1:] for pair in triples}) == 1:
            # all terms have both: their signs are enough
            signs = np.where(off < np.abs(middle), np.sign(middle), np.nan)
            found = found[0] * (signs[i[0]] * signs[j[0]]), found[1]
        else:
            found = _times(_times(found, (middle[i], off[i])), (middle[j], off[j]))
    return *found, known.at((name,), (wide,), ORDER)


def _products(vectors: Model, derived: list[int], i: list[int], j: list[int]) -> Ranges:
    """Return the ranges of the triple products of vectors, given by number."""
    inner, slopes = _narrow(vectors), _slope(vectors)
    one, other = (
        Model(inner.terms[:, :, x][:, :, :, turn], inner.radius[x][:, turn], inner.error)
        for x, turn in ((i, _ONE), (j, _OTHER))
    )
    first, second = _coordinates(mul(one, other, ORDER), 3)
    slopes = Model(slopes.terms[:, :, derived], slopes.radius[derived], slopes.error)
    x, y, z = _coordinates(mul(slopes, add(first, neg(second)), ORDER), 1)
    total = add(add(x, y), z)
    return total.centre[:, 0], total.reach[:, 0]


def _times(x: Ranges, y: Ranges) -> Ranges:
    """Return the ranges of products."""
    (a, da), (b, db) = x, y
    middle, size = a * b, np.abs(b) + db
    return middle, (np.abs(a) * db + da * size + UNIT * np.abs(middle)) * SLACK + TINY


def _stacked(models: Sequence[Model], size: int, count: int) -> Model:
    """Return models of coordinates as one of vectors, terms (degrees, 1, vectors, size, boxes).

    By what computed numbers are off is of no interest here.
    """
    terms = np.zeros((ORDER + 1, len(models), count))
    radius = np.empty((len(models), count))
    for i, model in enumerate(models):
        terms[: len(model.terms), i] = model.terms[:, 0, :, 0]
        radius[i] = model.radius[:, 0]
    shape = len(models) // size, size, count
    return Model(terms.reshape(ORDER + 1, 1, *shape), radius.reshape(shape), np.zeros((1, 1, 1)))


def _coordinates(model: Model, size: int) -> list[Model]:
    """Return the model of so many coordinates each."""
    terms, radius, error = model.terms, model.radius, model.error
    return [
        Model(terms[:, :, :, i : i + size], radius[:, i : i + size], error[:, i : i + size])
        for i in range(0, radius.shape[1], size)
    ]


def _narrow(model: Model) -> Model:
    """Return the model on the discs of the boxes themselves: powers of two are exact."""
    return Model(model.terms * _shares(0), model.radius + TINY, model.error)


def _slope(model: Model) -> Model:
    """Return the derivative on the discs of the boxes, times half their lengths."""
    terms = model.terms[1:] * _shares(1)[1:]
    lost = np.add.reduce(np.abs(terms), axis=(0, 1)) * (2 * UNIT)
    radius = (model.radius / (WIDER - 1) + lost + TINY) * SLACK
    return Model(terms, radius, model.error)


@lru_cache(maxsize=2)
def _shares(times: int) -> Array:
    """Return what becomes of terms by degree: of a polynomial, or (1) of its derivative."""
    degrees = np.arange(ORDER + 1.0)
    return np.asarray((degrees**times / WIDER**degrees)[:, None, None, None, None])
