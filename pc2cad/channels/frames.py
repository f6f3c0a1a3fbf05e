"""Frames along a guide: the points R and Q at distance 1 from N in its normal plane."""

from __future__ import annotations

from dataclasses import dataclass
from fractions import Fraction
from typing import Final

import numpy as np

from pc2cad.arrays import Array
from pc2cad.channels import guide_functions
from pc2cad.channels.guides import Guide
from pc2cad.channels.minimising import minimising
from pc2cad.channels.normals import (
    LEAST_SINE,
    FrameError,
    Pair,
    ReferenceAlongTangentError,
    across,
    from_reference,
    mitred,
    turned,
)
from pc2cad.equation.points import (
    Combination,
    Kind,
    Value,
    derivative,
    kind_of,
)
from pc2cad.expression.tree import ONE, ZERO, Expr, Number, as_expr, number, pieces, symbol

#: from here on neighbouring normals are two: ten times what tangents may differ by
JUMP: Final = 1e-7
KINDS: Final = ("rotation-minimising", "point", "direction", "frenet")

_REFERRED: Final = {
    "point": "normal towards a fixed point",
    "direction": "normal towards a fixed direction",
    "frenet": "Frenet",
}


@dataclass(frozen=True, eq=False, repr=False)
class Frame:
    """The normal plane of a guide, carried along it."""

    guide: Guide
    #: free vectors of length 1 (at a mitre: longer, in the cutting plane), functions of u
    normal: Combination
    binormal: Combination
    #: how it was found, for people
    words: str
    #: share of a turn by which the end of a closed guide is ahead of its beginning
    shift: float = 0.0

    def __repr__(self) -> str:
        return f"<Frame: {self.words}; guide: {self.guide.words}>"

    @property
    def N(self) -> Combination:
        """The point of the guide."""
        return self.guide.N

    @property
    def R(self) -> Combination:
        """The point at distance 1 along the normal."""
        return self.N + self.normal

    @property
    def Q(self) -> Combination:
        """The point at distance 1 along the binormal."""
        return self.N + self.binormal

    def shifted(self, M: Combination) -> Combination:
        """Return M with breaks in v where the end of a closed guide is glued on one step ahead.

        Nothing changes but that the faces end there: they are glued whole.
        """
        if not self.shift:
            return M
        count = Fraction(self.shift).limit_denominator(1000).denominator
        breaks = tuple(Fraction(i, count) for i in range(count + 1))
        rows = tuple((number(b), ONE) for b in breaks[:-1])
        around = pieces(symbol("v"), breaks, rows, smoothness=0, closed=False)
        return M.substitute({"v": around})


def frame(
    guide: Guide,
    kind: str = "rotation-minimising",
    reference: Value | None = None,
    twist: Expr | Number = 0,
    symmetry: int = 1,
) -> Frame:
    """Return a frame along a guide.

    `reference`: for ``point`` the fixed point E, for ``direction`` a free vector; for
    ``rotation-minimising`` either says where the normal points at the beginning (default: as near
    to the z axis as can be, or to the x axis). `twist` is an angle in u by which the frame is
    turned in addition. On a closed guide the rotation-minimising frame is turned, evenly along the
    length, until its end fits its beginning, or one that looks the same for a section of this
    `symmetry`. Raises ReferenceAlongTangentError or FrameError.
    """
    if kind not in KINDS:
        raise FrameError(f"the kind of a frame is one of {', '.join(KINDS)}, not '{kind}'")
    _check_reference(kind, reference)
    if symmetry < 1:
        raise FrameError("the symmetry of a section is 1 or more")
    turn = as_expr(twist)
    if not turn.symbols <= {"u"}:
        raise FrameError("the twist of a frame depends on u alone")
    if kind == "rotation-minimising":
        own, words, shift = minimising(guide, reference, symmetry)
    else:
        own = [_referred(guide, i, kind, reference) for i in range(len(guide.parts))]
        _check_joints(guide, own, kind)
        words, shift = _REFERRED[kind], 0.0
    if turn is not ZERO:
        own = [turned(pair, turn) for pair in own]
        words += ", with a twist of its own"
    own = [
        mitred(guide, i, pair) if any(guide.parts[i].mitres) else pair for i, pair in enumerate(own)
    ]
    normals, binormals = zip(*own, strict=True)
    return Frame(guide, guide.join(normals), guide.join(binormals), words, shift)


def _check_reference(kind: str, reference: Value | None) -> None:
    found = None if reference is None else kind_of(reference)
    wanted = {"point": (Kind.POINT,), "direction": (Kind.VECTOR,), "frenet": (None,)}.get(
        kind, (None, Kind.POINT, Kind.VECTOR)
    )
    if found not in wanted:
        names = {"point": "a fixed point", "direction": "a free vector", "frenet": "no reference"}
        raise FrameError(
            f"a frame of the kind {kind} takes {names.get(kind, 'a point or a free vector')}"
        )


# -- frames with a reference -----------------------------------------------------------------------


def _referred(guide: Guide, index: int, kind: str, reference: Value | None) -> Pair:
    part = guide.parts[index]
    if kind == "frenet":
        towards = derivative(part.point, "u", 2)
    else:
        assert isinstance(reference, Combination)
        towards = reference - part.point if kind == "point" else reference
    assert isinstance(towards, Combination)
    _check_sine(guide, index, towards, kind)
    return from_reference(part, towards)


def _check_sine(guide: Guide, index: int, towards: Combination, kind: str) -> None:
    part = guide.parts[index]
    roots = (*towards.coordinates, *part.speed.coordinates)

    def sine(u: Array) -> Array:
        found = guide_functions.values(roots, u)
        q, t = found[:3], found[3:]
        size = np.linalg.norm(q, axis=0) * np.linalg.norm(t, axis=0)
        with np.errstate(all="ignore"):
            return np.asarray(np.linalg.norm(np.cross(q, t, axis=0), axis=0) / size)

    place, least = guide_functions.smallest(sine, *guide.limits(index))
    flip = _flip(roots, *guide.limits(index))
    if flip is not None:
        place, least = flip, 0.0
    if not least >= LEAST_SINE:
        what = {
            "point": "the fixed point lies on the tangent",
            "direction": "the fixed direction lies along the tangent",
            "frenet": "the guide is straight or has an inflection",
        }[kind]
        shown = "0" if not np.isfinite(least) else f"{least:.3g}"
        raise ReferenceAlongTangentError(
            f"the normal of the guide is undefined at u = {place:.6g}: {what} there (sine {shown}, "
            f"at least {LEAST_SINE:g} is needed); the rotation-minimising frame has no such place"
        )


def _check_joints(guide: Guide, own: list[Pair], kind: str) -> None:
    """Raise FrameError where the normal jumps from one part of the guide to the next."""
    count = len(own)
    for index in range(count if guide.closed else count - 1):
        following = (index + 1) % count
        end = guide_functions.at(own[index][0].coordinates, guide.limits(index)[1])
        start = guide_functions.at(own[following][0].coordinates, guide.limits(following)[0])
        if guide.parts[index].mitres[1] is not None:
            end = across(end, guide, index)
        if not np.linalg.norm(start - end) <= JUMP:
            raise FrameError(
                f"a frame of the kind {kind} does not go on from part {index + 1} of the guide to "
                f"part {following + 1}: its normal jumps there, at u = "
                f"{guide.limits(index)[1]:.6g}; the rotation-minimising frame goes on everywhere"
            )


def _flip(roots: tuple[Expr, ...], low: float, high: float) -> float | None:
    """Return where the normal jumps to its opposite, as Frenet's does at an inflection."""
    for _ in range(5):
        u = np.linspace(low, high, 129)
        found = guide_functions.values(roots, u)
        side = np.cross(found[:3], found[3:], axis=0)
        turns = (side[:, 1:] * side[:, :-1]).sum(axis=0)
        i = int(np.argmin(turns))
        if not turns[i] < 0:
            return None
        low, high = float(u[i]), float(u[i + 1])
    return (low + high) / 2
