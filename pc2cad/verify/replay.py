"""A certificate held against the bytes of its file and its template, by arithmetic alone.

This module is the whole checker: NumPy and the standard library are all that it uses, so that it
may be copied, read and run by itself. What it finds, and how, is in docs/certificate.md.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections import Counter
from collections.abc import Callable, Sequence
from functools import cached_property
from math import log, pi, prod
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = Callable[..., Any]
FORMAT: Final = "pc2cad certificate 2"
#: unit of rounding; what every step adds to a radius, relative to it; library functions' error
UNIT, OUT, LIBRARY = 2.0**-53, 1.0 + 1e-12, 8 * 2.0**-53
#: degrees above a spline's that are interpolated with, and the highest; places looked at at a
#: time, and most values at the places of a face
MORE, HIGHEST, BLOCK, WORK = 3, 24, 150_000, 1_000_000_000


class ReplayError(Exception):
    """The certificate does not hold; the sentence says what of it."""


class Jet:
    """Taylor coefficients along one parameter: balls around real centres, over a grid of places.

    Centres and radii have the shape (coefficients, places…), or 1 where all places have the same;
    further coefficients are 0. One radius may be that of all. What is not known is no number.
    """

    def __init__(self, c: Any, r: Any) -> None:
        """Take centres and radii."""
        self.c, self.r = np.asarray(c, dtype=float), np.asarray(r, dtype=float)

    @cached_property
    def size(self) -> Array:
        """Return the absolute centres; where one radius is that of all, the largest of them."""
        few = self.r.size == 1
        return np.full_like(self.r, max(self.c.max(), -self.c.min())) if few else np.abs(self.c)

    def __getitem__(self, part: slice) -> Jet:
        """Return some of the coefficients."""
        return Jet(self.c[part], self.r[part])

    def __neg__(self) -> Jet:
        """Return the negative."""
        return Jet(-self.c, self.r)

    def __add__(self, other: Jet) -> Jet:
        """Return the sum."""
        r = _sum(self.r + UNIT * self.size, other.r + UNIT * other.size)
        return Jet(_sum(self.c, other.c), r * OUT)

    def __mul__(self, other: Jet) -> Jet:
        """Return the product, cut off behind the longer series."""
        a, b = (self, other) if len(self.c) <= len(other.c) else (other, self)
        off = b.r + (len(b.c) + 3) * UNIT * b.size
        r = _product(a.size, off) + _product(a.r, b.size + off)
        return Jet(_product(a.c, b.c), r * OUT + 1e-300)

    def integral(self, slope: Jet) -> Jet:
        """Return the function of no constant term whose derivative by this is `slope`."""
        k = np.arange(1.0, len(self.c)).reshape(-1, *(1,) * (self.c.ndim - 1))
        own = slope[: len(k)] * Jet(self.c[1:] * k, self.r[1:] * k)
        r = (own.r + 4 * UNIT * own.size) / k
        return Jet(*(np.concatenate((np.zeros_like(x[:1]), x)) for x in (own.c / k, r * OUT)))

    def flow(self, function: Function, slope: Function, known: Any = None) -> Jet:
        """Return a function that rises or falls, of derivative `slope` in its value and `known`."""
        low, high = function(self.c[:1] - self.r[:1]), function(self.c[:1] + self.r[:1])
        off = 0.5 * np.abs(high - low) + LIBRARY * (np.abs(low) + np.abs(high))
        found = head = Jet(0.5 * (low + high), off * OUT + 1e-300)
        for k in range(2, len(self.c) + 1):  # each time one more coefficient is known
            found = head + self[:k].integral(slope(found, known))
        return found


def number(value: float, rounding: float = UNIT) -> Jet:
    """Return all numbers that are rounded to one."""
    return Jet([value], [abs(value) * rounding])


def _sum(a: Array, b: Array) -> Array:
    a, b = (a, b) if len(a) <= len(b) else (b, a)
    found = np.asarray(a + b[: len(a)])
    rest = [np.broadcast_to(x, found.shape[1:]) for x in b[len(a) :]]
    return np.concatenate((found, rest)) if rest else found


def _product(a: Array, b: Array) -> Array:
    found = np.asarray(a[:1] * b)
    for k in range(1, len(a)):
        found[k:] += a[k] * b[: len(b) - k]
    return found


def _inverse(a: Jet) -> Jet:
    known = Jet(np.where(np.abs(a.c[:1]) > a.r[:1], a.c, np.nan), a.r)  # not zero
    return known.flow(lambda x: 1.0 / x, lambda y, _: -(y * y))


def _sine(a: Jet) -> Jet:
    s, o, r = np.sin(a.c[:1]), np.cos(a.c[:1]), a.r[:1]
    first = sine = Jet(s, np.minimum(np.abs(o) * r + r * r, 2.0) + LIBRARY)
    other = cosine = Jet(o, np.minimum(np.abs(s) * r + r * r, 2.0) + LIBRARY)
    for k in range(2, len(a.c) + 1):
        sine, cosine = first + a[:k].integral(cosine), other + -a[:k].integral(sine)
    return sine


OPERATIONS: Final[dict[str, Function]] = {
    "add": lambda a, b: a + b,
    "mul": lambda a, b: a * b,
    "neg": lambda a: -a,
    "inverse": _inverse,
    "log": lambda a: a.flow(np.log, lambda _, known: known, _inverse(a)),
    "exp": lambda a: a.flow(np.exp, lambda y, _: y),
    "sin": _sine,
    "cos": lambda a: _sine(a + number(pi / 2)),
    "atan": lambda a: a.flow(np.arctan, lambda _, known: known, _inverse(a * a + number(1.0))),
}


def run(program: Sequence[Sequence[Any]], s: Jet, t: Jet) -> list[Jet]:
    """Return the values of all rows of a program at two parameters."""
    values: list[Jet] = []
    for op, *rest in program:
        if op == "number":
            values.append(number(float(rest[0])))
        elif op == "symbol":
            values.append((s, t)[rest[0]])
        elif op in OPERATIONS:
            values.append(OPERATIONS[op](*(values[k] for k in rest)))
        else:
            raise ReplayError(f"the operation {op!r}, which is not known here")
        if s.r.size == t.r.size == len(s.c) == len(t.c) == 1:
            values[-1] = Jet(values[-1].c, values[-1].r.max(keepdims=True))
    return values


class Spline:
    """A B-spline surface without weights, over parameters from 0 to 1."""

    def __init__(self, degrees: Sequence[int], knots: Sequence[Array], poles: Array) -> None:
        """Take degrees, knots and poles as the file has them."""
        self.degrees, self.poles = degrees, poles
        self.knots = [(k - k[p]) / (k[-p - 1] - k[p]) for p, k in zip(degrees, knots, strict=True)]

    def at(self, nodes: Sequence[Array]) -> tuple[Array, float]:
        """Return values at places of both parameters, and how far they may be off.

        A row of places is in one span of the knots; values have the shape (3, *places, *places).
        """
        found, off = np.ascontiguousarray(self.poles.transpose(2, 0, 1)), 0.0
        for p, k, x in zip(self.degrees, self.knots, nodes, strict=True):
            # by Cox and de Boor, all B-splines at once
            cell, x = np.repeat(x.mean(axis=1), x.shape[1])[:, None], x.reshape(-1, 1)
            rows = (k[:-1] <= cell) & (cell < k[1:])
            for d in range(1, p + 1):
                rises = np.nan_to_num((x - k[: -1 - d]) / (k[d:-1] - k[: -1 - d]))
                falls = np.nan_to_num((k[d + 1 :] - x) / (k[d + 1 :] - k[1:-d]))
                rows = rises * rows[:, :-1] + falls * rows[:, 1:]
            # sums of products without cancellation; and a parameter that is off by a few units
            steps = np.linalg.norm(np.diff(found, axis=1), axis=0).max(axis=1)
            slope = p * (steps / (k[1 + p : -1] - k[1 : -1 - p])).max()
            off += 8 * UNIT * ((p + 2) * np.linalg.norm(found, axis=0).max() + slope)
            found = np.ascontiguousarray((rows @ found).transpose(0, 2, 1))
        return found.reshape(3, *nodes[0].shape, *nodes[1].shape), float(off)


class Quadric:
    """A plane, or a cylinder, cone, sphere or torus: places as far from something as its radius."""

    KINDS = ("PLANE", "CYLINDRICAL_SURFACE", "CONICAL_SURFACE", "SPHERICAL_SURFACE",
             "TOROIDAL_SURFACE")  # fmt: skip
    degrees, knots = (7, 7), (np.array([0.0, 1.0]),) * 2

    def __init__(self, kind: str, frame: tuple[Array, Array], lengths: Sequence[float]) -> None:
        """Take the placement, and the lengths; of a cone its radius and angle."""
        self.kind, (self.origin, self.axes), self.lengths = kind, frame, lengths

    def height(self, point: list[Jet]) -> tuple[list[Jet], Jet | None]:
        """Return the height over a plane; of others distance² - radius², and the radius."""
        d = [x + number(-float(o)) for x, o in zip(point, self.origin, strict=True)]
        axes = [[Jet([n], [8 * UNIT]) for n in axis] for axis in self.axes]
        x, y, z = (d[0] * n[0] + d[1] * n[1] + d[2] * n[2] for n in axes)
        if self.kind == "PLANE":
            return [z], None
        square, r = x * x + y * y, number(self.lengths[0])
        if self.kind == "SPHERICAL_SURFACE":
            square += z * z
        elif self.kind == "CONICAL_SURFACE":
            r += z * number(float(np.tan(self.lengths[1])), LIBRARY)
        elif self.kind == "TOROIDAL_SURFACE":
            root = OPERATIONS["exp"](OPERATIONS["log"](square) * number(0.5))
            aside, r = root + -r, number(self.lengths[1])
            square = aside * aside + z * z
        return [square + -(r * r)], r


class Difference:
    """What a side's program computes, less the surface that it is held against, over cells."""

    def __init__(self, claim: dict[str, Any], surface: Spline | Quadric) -> None:
        """Take a claim; raise ReplayError where its cells are no partition that serves."""
        self._program, self._outputs, self.surface = claim["program"], claim["outputs"], surface
        self.degrees = [p + MORE for p in surface.degrees]
        self.cells = [np.array(row, dtype=float) for row in claim["cells"]]
        for x, knots in zip(self.cells, surface.knots, strict=True):
            ends = x[0] == 0.0 and x[-1] == 1.0 and np.isin(knots, x).all()
            if not (ends and np.all(np.diff(x) > 0.0) and np.all(np.diff(knots) >= 0.0)):
                raise ReplayError("cells that are no partition of the surface's spans")
        places = prod(len(x) * (m + 1) for x, m in zip(self.cells, self.degrees, strict=True))
        if places * len(self._program) > WORK or max(self.degrees) > HIGHEST:
            raise ReplayError("more values at the places of a face than are looked at")
        self._spread = [1.0 + 2.0 / pi * log(m + 1.0) for m in self.degrees]  # Lebesgue's constants

    def _at(self, s: Jet, t: Jet) -> tuple[list[Jet], Jet | None]:
        values = run(self._program, s, t)
        point = [values[k] for k in self._outputs]
        return (point, None) if isinstance(self.surface, Spline) else self.surface.height(point)

    def _over(self, axis: int, order: int) -> tuple[list[Jet], Jet | None]:
        """Return `_at` at all places of the cells, as series in half cells along an axis."""
        jets = []
        for k, (x, shape) in enumerate(zip(self.cells, ((-1, 1), (1, -1)), strict=True)):
            half = (0.5 * np.diff(x) * OUT + 2 * UNIT).reshape(shape)
            c, r = np.zeros((2, order + 1 if k == axis else 1, *half.shape))
            c[0], r[0], c[1:2] = (0.5 * (x[:-1] + x[1:])).reshape(shape), half, half
            jets.append(Jet(c, r))
        return self._at(jets[0], jets[1])

    def _interpolant(self) -> Array:
        """Return bounds of the interpolant in cells: the sums of its Chebyshev coefficients."""
        k = [np.arange(m + 1) for m in self.degrees]
        nodes = [x[:-1, None] + np.diff(x)[:, None] * (0.5 - 0.5 * np.cos(pi * i / i[-1]))
                 for x, i in zip(self.cells, k, strict=True)]  # fmt: skip
        a, b = map(_chebyshev, k)
        known, off, one = np.zeros((1, len(nodes[0]), 1, 1, 1)), 0.0, False
        if isinstance(self.surface, Spline):  # of others a root may be taken of what is found
            (known, off), one = self.surface.at(nodes), True
        parts, step = [], max(1, BLOCK // (nodes[1].size * len(a)))
        for first in range(0, len(nodes[0]), step):
            own = slice(first, first + step)
            places = nodes[0][None, own, :, None, None], nodes[1][None, None, None]
            s, t = (Jet(x, np.full((1,) * 5 if one else x.shape, 4 * UNIT)) for x in places)
            found, _ = self._at(s, t)
            gaps = np.stack(np.broadcast_arrays(*(jet.c[0] for jet in found), s.c[0] + t.c[0])[:-1])
            gaps = (gaps - known[:, own]).transpose(0, 1, 3, 2, 4)
            sums = np.linalg.norm(a @ gaps @ b.T, axis=0).sum(axis=(2, 3))
            # what rounding may add to values, and to the coefficients
            radii = sum(jet.r[0] for jet in found).max(axis=(1, 3)) + off
            more = 1e-9 * np.linalg.norm(gaps, axis=0).max(axis=(2, 3))
            parts.append(sums + radii * prod(self._spread) + more)
        return np.concatenate(parts)

    def remainder(self, axis: int) -> Array:
        """Return how far the interpolant along an axis may be off in cells.

        On a cell of half length h the interpolant of degree m at Chebyshev's extreme places is off
        by at most 2^(1-m) times the Taylor coefficient m + 1 of x -> M(middle + h x).
        """
        m, total = self.degrees[axis], np.zeros((1, 1))
        for jet in (jet for jet in self._over(axis, m + 1)[0] if len(jet.c) > m + 1):
            total = total + (np.abs(jet.c[-1]) + jet.r[-1]) ** 2
        return np.asarray((self._spread[0] if axis else 1.0) * 2.0 ** (1 - m) * np.sqrt(total))

    def distances(self, heights: Array) -> Array:
        """Return bounds of the distance from the surface in cells, from those of `height`."""
        if (r := self._over(0, 0)[1]) is None:
            return heights
        # |d² - r²| is |d - r| (d + |r|), and neither factor is less than the first
        found = heights / np.maximum(np.abs(r.c[0]) - r.r[0], 1e-300)
        return np.asarray(np.minimum(found, np.sqrt(heights)))

    def bound(self) -> float:
        """Return a bound of the distance between side and surface."""
        with np.errstate(all="ignore"):
            total = self.distances(self._interpolant() + self.remainder(0) + self.remainder(1))
        return float(np.nan_to_num(total.max() * (1.0 + 1e-9), nan=np.inf))


def _chebyshev(k: Any) -> Array:
    """Return the matrix from values at Chebyshev's extreme places to coefficients."""
    ends = np.where(k % k[-1] == 0, 0.5, 1.0)
    waves = np.cos(pi * np.outer(k, k) / k[-1]) * (-1.0) ** k[:, None]
    return np.asarray(2.0 / k[-1] * ends[:, None] * waves * ends)


class StepText:
    """The instances of a STEP file, read when they are asked for."""

    _INSTANCE = re.compile(r"#(\d+)\s*=\s*((?:[^;']|'[^']*')*);")
    _RADIAN = re.compile(r"[^']*\bSI_UNIT\s*\(\s*\$\s*,\s*\.RADIAN\.\s*\)[^']*")
    _POINT = re.compile(r"(?:CARTESIAN_POINT|DIRECTION)\('',\(([^(),]+),([^(),]+),([^(),]+)\)\)")
    _TOKEN = re.compile(r"(?:'[^']*')+|[^\s(),']+|[()]")

    def __init__(self, data: bytes) -> None:
        """Take the bytes of a file."""
        found = self._INSTANCE.findall(data.decode("utf-8"))
        self._texts = {f"#{key}": body for key, body in found}
        if b"/*" in data or len(found) != len(self._texts):
            raise ReplayError("the file has comments, or an instance twice")

    def get(self, ref: str, *keywords: str) -> list[Any]:
        """Return keyword and parameters of an instance, which has to be one of the keywords."""
        keyword, _, rest = self._texts[ref].partition("(")
        if keyword.strip() not in keywords:
            raise ReplayError(f"{ref} is {keyword or 'several'} where {keywords[0]} is needed")
        change = {"(": "[", ")": "]"}
        plain = self._TOKEN.sub(lambda t: change.get(t[0]) or json.dumps(t[0]), f"({rest}")
        return [keyword.strip(), *json.loads(plain)]

    def point(self, ref: str) -> Array:
        """Return a point or a direction."""
        found = self._POINT.fullmatch(self._texts[ref])
        x, y, z = found.groups() if found else self.get(ref, "CARTESIAN_POINT", "DIRECTION")[2]
        return np.array([float(x), float(y), float(z)])

    def surface(self, face: str) -> Spline | Quadric:
        """Return the surface of a face; raise ReplayError where its kind is not known here."""
        kind, _, *rest = self.get(self.get(face, "ADVANCED_FACE")[3],
                                  "B_SPLINE_SURFACE_WITH_KNOTS", *Quadric.KINDS)  # fmt: skip
        if kind in Quadric.KINDS:
            units = [own for own in self._texts.values() if "PLANE_ANGLE_UNIT" in own] or [""]
            if kind == "CONICAL_SURFACE" and not all(map(self._RADIAN.fullmatch, units)):
                raise ReplayError("the file's only unit of plane angles is not the radian")
            _, _, origin, axis, along = self.get(rest[0], "AXIS2_PLACEMENT_3D")
            z, x = (v / np.linalg.norm(v) for v in (self.point(axis), self.point(along)))
            x = x - (x @ z) * z
            x = x / np.linalg.norm(x)
            frame = self.point(origin), np.array([x, np.cross(z, x), z])
            return Quadric(kind, frame, [float(length) for length in rest[1:]])
        p, q, rows, *_, often_u, often_v, u, v, _ = rest
        poles = np.array([[self.point(pole) for pole in row] for row in rows])
        knots = [np.repeat([float(x) for x in values], [int(n) for n in often])
                 for values, often in ((u, often_u), (v, often_v))]  # fmt: skip
        return Spline((int(p), int(q)), knots, poles)

    def closed(self) -> set[str]:
        """Ask every shell for each edge once forward and once reversed; return the faces."""
        faces: set[str] = set()
        for shell in [key for key, own in self._texts.items() if own.startswith("CLOSED_SHELL")]:
            uses: Counter[tuple[str, bool]] = Counter()
            for face in self.get(shell, "CLOSED_SHELL")[2]:
                faces.add(face)
                for bound in self.get(face, "ADVANCED_FACE")[2]:
                    _, _, loop, flag = self.get(bound, "FACE_OUTER_BOUND", "FACE_BOUND")
                    kind, _, own = self.get(loop, "EDGE_LOOP", "VERTEX_LOOP")
                    for use in own if kind == "EDGE_LOOP" else ():
                        *_, edge, sense = self.get(use, "ORIENTED_EDGE")
                        uses[edge, sense == flag] += 1
            if wrong := {e for e, _ in uses if (uses[e, True], uses[e, False]) != (1, 1)}:
                raise ReplayError(f"the edge {min(wrong)} is not used once in each sense")
        return faces


def replay(certificate: dict[str, Any], file: bytes, template: bytes | None = None) -> list[str]:
    """Return what was found again, in sentences; raise ReplayError where something does not hold.

    Of the template the hash alone is compared: that the programs are its sides is trusted.
    """
    if certificate.get("format") != FORMAT or certificate.get("verified") is not True:
        raise ReplayError(f"no certificate of a verified file in the form of {FORMAT!r}")
    for what, data in (("file", file), ("template", template)):
        known = certificate[what] and certificate[what]["sha256"]
        if data is not None and hashlib.sha256(data).hexdigest() != known:
            raise ReplayError(f"the {what} is not the one that the certificate is of")
    text, claims = StepText(file), certificate["faces"]
    faces, tolerance = text.closed(), float(certificate["tolerance"])
    if faces != {f"#{claim['face']}" for claim in claims}:
        raise ReplayError("the faces of the file's shells are not those of the certificate")
    done, largest = 0, 0.0
    for claim in claims:
        name, stated = f"the face #{claim['face']} ({claim['side']})", float(claim["distance"])
        if not stated <= tolerance:
            raise ReplayError(f"{name} is stated {stated:.3g} off, {tolerance:.3g} are allowed")
        for patch in claim["replay"]:
            found = Difference(patch, text.surface(f"#{claim['face']}")).bound()
            if not found <= stated * (1.0 + 1e-6):
                raise ReplayError(f"{name}: {found:.3g} is found where {stated:.3g} is stated")
            largest = max(largest, found)
        done += bool(claim["replay"])
    return [
        f"closed: every edge of {len(faces)} faces is used once in each sense (exact)",
        f"{done} of {len(claims)} faces bounded anew: none further than {largest:.3g} "
        f"{certificate['units']} from its side ({tolerance:.3g} allowed)",
        f"stated, not found again: {len(claims) - done} faces, borders and integrals",
    ]
