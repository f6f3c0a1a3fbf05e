"""The orient stage: det J keeps one sign.

Input: Mapping3. Output: Orientation.

The sign is proved (`jacobian_proof`), or else a watch on the map (`domain.jacobian_watch`) is led
over the box. Zeros on collapsed sides and along tangent edges are normal; both signs are not.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from functools import lru_cache, partial
from math import hypot, prod

import numpy as np

from pc2cad.arrays import Array
from pc2cad.bounds.known import Models
from pc2cad.domain.jacobian_watch import ERROR, ROUNDING, JacobianWatch
from pc2cad.domain.map import SPEED_PLACES, Mapping3, speeds_of
from pc2cad.expression.identity import Verdict
from pc2cad.expression.parameters import PARAMETERS
from pc2cad.expression.polynomials import Polynomials, polynomials
from pc2cad.expression.tree import number, substitute, symbol
from pc2cad.solidity.jacobian_proof import proved_sign, sign_by_algebra

#: places per direction of the first sweep, its ends included
SWEEP = 11
#: starts and steps of the search for the smallest value
STARTS, STEPS = 12, 30
#: what is made small: a value at each of broadcastable places
Measure = Callable[[Array, Array, Array], Array]
#: inner places at which det J may be zero though it keeps its sign: u, v and w of a grid
INNER = (0.21, 1 / 3, 0.5, 2 / 3, 0.83)
#: a smallest value that hardly falls any more is clear of zero above this
CLEAR = 0.02


@dataclass(frozen=True)
class Orientation:
    """The sign of det J, and where inside the box it is zero all the same."""

    #: +1 where (u, v, w) is right-handed in the solid, -1 where it is left-handed
    sign: int
    #: PROVED (see `jacobian_proof`), or UNDECIDED where it only held wherever it was looked at
    verdict: Verdict
    #: a sentence on an inner place where det J vanishes without changing its sign, or nothing
    warning: str = ""
    #: what the proof found of trees, on boxes that fill the box
    models: tuple[Models, ...] = field(default=(), compare=False, repr=False)

    @property
    def is_proved(self) -> bool:
        """Whether the sign is proved for the whole box."""
        return self.verdict is Verdict.PROVED

    @property
    def axes(self) -> tuple[int, int, int]:
        """u, v and w in an order that is right-handed in the solid."""
        return (0, 1, 2) if self.sign > 0 else (1, 0, 2)


def find_orientation(mapping: Mapping3, known: int = 0) -> Orientation:
    """Return the sign of det J, which may be `known` by proof (0: it is not).

    Where it is not proved, a sweep over the closed box is followed by a search for the smallest
    value from the worst places. Raises FlatMapError or FoldedMapError.
    """
    unproved: list[Array] = []
    models: list[Models] = []
    proved = known or proved_sign(mapping, unproved, models)
    if proved:
        warning = _inner_zero(mapping, proved)
        return Orientation(proved, Verdict.PROVED, warning, tuple(models))
    nodes = (np.polynomial.legendre.leggauss(SWEEP - 2)[0] + 1) / 2
    axis = np.concatenate(([0.0], nodes, [1.0]))
    watch = JacobianWatch(mapping, partial(_proved_within, mapping))
    grid = np.stack(np.meshgrid(axis, axis, axis, indexing="ij")).reshape(3, -1)
    places = np.concatenate([grid, *unproved], axis=1)
    determinant, _, sine = watch.note(mapping.tangents((0, 1, 2), *places), tuple(places))
    watch.check()
    sign = 1 if watch.extremes[1] > watch.extremes[-1] else -1
    # a crease or a slope makes the sine small where det J is not, and det J is where it shrinks
    place = _search(watch.see, watch, _worst(places, sign * sine), sign)
    _search(watch.volume, watch, _worst(places, sign * determinant), sign)
    # a zero on a side is normal; moved inside along it, it has to be gone
    inside = np.clip(place, 0.05, 0.95)
    warning = _zero_near(watch, float(sign * watch.see(*inside)), inside)
    return Orientation(sign, Verdict.UNDECIDED, warning)


def _proved_within(mapping: Mapping3, direction: int, low: float, high: float, sign: int) -> bool:
    """Say whether det J has a sign by algebra where one direction runs between two places."""
    name = PARAMETERS[direction]
    near, far = (number(Fraction(x).limit_denominator(10**9)) for x in (low, high))
    change = {name: near + (far - near) * symbol(name)}
    x, y, z = substitute(mapping.coordinates, change)
    return sign_by_algebra(replace(mapping, coordinates=(x, y, z), _programs={})) == sign


def _inner_zero(mapping: Mapping3, sign: int) -> str:
    """Return a warning where one of a few inner places has det J = 0."""
    known = polynomials(mapping.coordinates)
    if known is not None and _is_clear(known):
        return ""
    places, count = _inner_places(), len(INNER) ** 3
    points, *tangents = mapping.frame(*places)
    speeds = speeds_of(points[count:], *(m[count:] for m in tangents))
    watch = JacobianWatch(mapping, speeds=speeds)
    sine = sign * watch.note([m[:count] for m in tangents], tuple(places[:, :count]))[2]
    # without a value, or where parts meet in parameters that are slowed down there, it says nothing
    idle = ~np.isfinite(sine)
    for row, joints in zip(places[:, :count], mapping.joints, strict=True):
        idle |= np.isin(row, [float(x) for x in joints])
    if idle.all():
        return ""
    least = int(np.argmin(np.where(idle, np.inf, sine)))
    return _zero_near(watch, float(sine[least]), places[:, least])


@lru_cache(maxsize=1)
def _inner_places() -> Array:
    """Return the inner places and, to be evaluated with them, those of a map's speeds, (3, n)."""
    grids = (np.meshgrid(*[axis] * 3, indexing="ij") for axis in (INNER, SPEED_PLACES))
    return np.concatenate([np.reshape(grid, (3, -1)) for grid in grids], axis=1)


def _is_clear(known: Polynomials) -> bool:
    """Say whether coefficients show that the quotient which a watch sees inside is not nought.

    Tangents and coordinates are no longer than the sums of their coefficients' sizes.
    """
    unit = max(sum(map(abs, f.values())) for f in known.map)  # no figure overflows in terms of it
    determinant: Array = np.zeros(np.max([*known.determinant, (0, 0, 0)], axis=0) + 1)
    for powers, c in known.determinant.items():
        determinant[powers] = c / unit**3
    for _ in range(3):  # each time along the first axis, which becomes the last
        determinant = np.tensordot(determinant, _powers(len(determinant)), (0, 1))
    lengths = [
        hypot(*(sum(map(abs, f.values())) / unit for f in tangent)) for tangent in known.tangents
    ]
    divisor = prod(lengths)
    for d, length in enumerate(lengths):
        divisor += ERROR / ROUNDING * max(length, 1.0) * prod(lengths[:d] + lengths[d + 1 :])
    return bool(np.abs(determinant).min() > 200 * ROUNDING * divisor)


@lru_cache(maxsize=16)
def _powers(count: int) -> Array:
    """Return the first powers of the inner places, (places, count)."""
    return np.array(INNER)[:, None] ** np.arange(count)


def _zero_near(watch: JacobianWatch, sine: float, place: Array) -> str:
    """Return a warning where the quotient that `watch` sees at a place is nought."""
    if not sine < 100 * ROUNDING:  # nan: no value is no zero
        return ""
    return (
        f"det J vanishes inside the box, near {watch.mapping.shown(place)}, without changing its "
        "sign: the solid is sound, but its parameters are singular there"
    )


def _search(measure: Measure, watch: JacobianWatch, places: Array, sign: int) -> Array:
    """Walk from some places (3, n) to smaller sign·measure.

    The stencil halves where it stands. The walk ends early where the smallest value is clear of
    zero, hardly falls any more, and what is around each place differs from it by less than half of
    it: a smaller step towards a crease or a narrow dip does not reach zero either. The last place
    of the smallest value is returned, (3,).
    """
    stencil = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij")).reshape(3, -1)
    centre = stencil.shape[1] // 2
    step = np.full(places.shape[1], 0.5 / SWEEP)
    before = np.inf
    for _ in range(STEPS):
        around = np.clip(places[:, :, None] + step[:, None] * stencil[:, None, :], 0.0, 1.0)
        values = sign * measure(*around)
        values = np.where(np.isfinite(values), values, np.inf)
        watch.check()
        best = values.argmin(axis=1)
        least = values.min(axis=1)
        step = np.where(best == centre, step / 2, step)
        places = np.take_along_axis(around, best[None, :, None], axis=2)[:, :, 0]
        smallest = float(least.min())
        even = bool((values.max(axis=1) < 1.5 * least).all())
        if smallest > CLEAR and before - smallest < 0.05 * smallest and even:
            break
        before = smallest
    return np.asarray(places[:, least.argmin()])


def _worst(places: Array, values: Array) -> Array:
    """Return the places (3, k) of the smallest values, half a step of the sweep apart."""
    order = np.argsort(np.where(np.isfinite(values), values, np.inf), kind="stable")
    chosen: list[int] = []
    for _ in range(STARTS):
        if not len(order):
            break
        chosen.append(order[0])
        ways = np.abs(places[:, order] - places[:, order[:1]]).max(axis=0)
        order = order[ways > 0.5 / SWEEP]
    return places[:, chosen]
