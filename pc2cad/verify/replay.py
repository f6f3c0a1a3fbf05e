"""A certificate held against the bytes of its file and its template, by arithmetic alone.

NumPy and the standard library are all that this module uses; it may be copied and run by itself.
The edges of every shell are counted in the file's text. For every face that the certificate holds
a program of, the surface's numbers are read from that text, the program is run over the cells with
balls (centre ± radius, rounded outwards), and the distance is bounded anew: docs/certificate.md.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Sequence
from math import log, pi, prod
from pathlib import Path
from typing import Any, Final

import numpy as np

from pc2cad.verify.balls import LIBRARY, OUT, UNIT, Array, Jet, ReplayError, constant, run
from pc2cad.verify.instances import StepText

FORMAT: Final = "pc2cad certificate 1"
#: most places of one face, and highest degree: a certificate that asks for more is not replayed
LARGEST, HIGHEST = 4_000_000, 24
#: places looked at at a time, which the processor's cache holds
BLOCK: Final = 150000
#: what reading a certificate or a file may end in that is none
UNREADABLE = (
    OSError, ValueError, LookupError, TypeError, AttributeError, ArithmeticError, RecursionError,
    MemoryError,
)  # fmt: skip


class Spline:
    """A polynomial B-spline surface of the file, turned so that it runs as its side does."""

    def __init__(self, degrees: Any, own: Any, poles: Array, turn: Sequence[bool]) -> None:
        """Take degrees, knots and poles as the file has them."""
        self.degrees, knots = list(degrees), []
        for degree, row in zip(degrees, own, strict=True):
            low, high = row[degree], row[-degree - 1]
            knots.append((row - low) / (high - low))
        swap, *back = turn
        for axis in (0, 1):
            if back[axis]:
                poles, knots[axis] = np.flip(poles, axis), 1.0 - knots[axis][::-1]
        if swap:
            poles = poles.transpose(1, 0, 2)
            self.degrees.reverse()
            knots.reverse()
        self.poles, self.knots = poles, knots

    def at(self, s: Array, t: Array) -> tuple[Array, float]:
        """Return values at places (cells, places) of both parameters, and how far they may be off.

        They have the shape (3, cells along s, along t, places along s, along t).
        """
        found = [_basis(k, p, x) for k, p, x in zip(self.knots, self.degrees, (s, t), strict=True)]
        (first, rows), (second, columns) = found
        size, off = float(np.linalg.norm(self.poles, axis=2).max()), 0.0
        for axis, (p, k) in enumerate(zip(self.degrees, self.knots, strict=True)):
            # sums of products without cancellation; and a parameter that is off by a few units
            steps = np.linalg.norm(np.diff(self.poles, axis=axis), axis=2).max(axis=1 - axis)
            gaps = k[1 + p : -1] - k[1 : -1 - p]
            off += 8 * (p + 2) * UNIT * size + 8 * UNIT * p * float((steps / gaps).max())
        own = self.poles.transpose(2, 0, 1)[:, first[:, None, :, None], second[None, :, None, :]]
        return rows[:, None] @ own @ columns.transpose(0, 2, 1), off

    def height(self, point: list[Jet]) -> tuple[list[Jet], Jet | None]:
        """Return what the surface's own values are taken from: places."""
        return point, None

    def distance(self, height: Array, _: Jet | None) -> Array:
        """Return the lengths themselves."""
        return height


def _basis(knots: Array, p: int, x: Array) -> tuple[Any, Array]:
    """Return the numbers of the B-splines that live in each cell, and their values at its places.

    By Cox and de Boor; every row of places is within one span of the knots.
    """
    middle = 0.5 * (x[:, 0] + x[:, -1])
    span = np.clip(np.searchsorted(knots, middle, side="right") - 1, p, len(knots) - p - 2)
    rows = np.ones((*x.shape, 1))
    for d in range(1, p + 1):
        left = knots[span[:, None] + np.arange(1 - d, 1)][:, None]
        right = knots[span[:, None] + np.arange(1, d + 1)][:, None]
        share = (x[:, :, None] - left) / (right - left)
        new = np.zeros((*x.shape, d + 1))
        new[..., :-1] += (1.0 - share) * rows
        new[..., 1:] += share * rows
        rows = new
    return span[:, None] + np.arange(-p, 1), rows


class Quadric:
    """A plane, cylinder, cone, sphere or torus as a function that is zero on it."""

    KINDS = ("PLANE", "CYLINDRICAL_SURFACE", "CONICAL_SURFACE", "SPHERICAL_SURFACE",
             "TOROIDAL_SURFACE")  # fmt: skip

    def __init__(self, kind: str, frame: tuple[Array, Array], lengths: Sequence[float]) -> None:
        """Take the placement and the lengths."""
        self.kind, (self.origin, self.axes), self.lengths = kind, frame, lengths

    def height(self, point: list[Jet]) -> tuple[list[Jet], Jet | None]:
        """Return the function at a point, and for a cone the radius at its height."""
        d = [x - constant(float(o)) for x, o in zip(point, self.origin, strict=True)]
        x, y, z = (
            sum((a * Jet([[[n]]], [[[8 * UNIT]]]) for a, n in zip(d, axis, strict=True)), NONE)
            for axis in self.axes
        )
        if self.kind == "PLANE":
            return [z], None
        r, k, square = constant(self.lengths[0]), None, x * x + y * y
        if self.kind == "SPHERICAL_SURFACE":
            square = square + z * z
        elif self.kind == "CONICAL_SURFACE":
            r = k = r + z * constant(float(np.tan(self.lengths[1])), LIBRARY)
        elif self.kind == "TOROIDAL_SURFACE":
            minor = constant(self.lengths[1])
            q = square + z * z + (r * r - minor * minor)
            return [q * q - constant(4.0, 0.0) * r * r * square], None
        return [square - r * r], k

    def distance(self, height: Array, radius: Jet | None) -> Array:
        """Return bounds of the distance from bounds of the function."""
        if self.kind == "PLANE":
            return np.asarray(height)
        if self.kind == "TOROIDAL_SURFACE":
            big, small = self.lengths
            if not big > small:
                raise ReplayError("a torus that meets its axis")
            return np.asarray(height / ((big * big - small * small) * small))
        if radius is None:
            return np.asarray(height / self.lengths[0])
        # |ρ - k| (ρ + |k|) is known, and neither factor is less than the first
        least = np.maximum(np.abs(radius.c[0]) - radius.r[0], 1e-300)
        return np.asarray(np.minimum(height / least, np.sqrt(height)))


NONE: Final = constant(0.0, 0.0)


class Difference:
    """A side's program over cells, and the surface that it is held against."""

    def __init__(self, claim: dict[str, Any], surface: Spline | Quadric) -> None:
        """Take a face's claim; raise ReplayError where its cells are no partition that serves."""
        self._program, self._outputs, self.surface = claim["program"], claim["outputs"], surface
        self.degrees = [int(m) for m in claim["degrees"]]
        self._cells = [np.array(row, dtype=float) for row in claim["cells"]]
        places = 1
        for points, m, axis in zip(self._cells, self.degrees, (0, 1), strict=True):
            if not (1 <= m <= HIGHEST and points[0] == 0.0 and points[-1] == 1.0
                    and np.all(np.diff(points) > 0.0)):  # fmt: skip
                raise ReplayError("cells that are no partition, or of a degree out of range")
            if isinstance(surface, Spline) and not (
                surface.degrees[axis] <= m
                and set(surface.knots[axis].tolist()) <= set(points.tolist())
            ):
                raise ReplayError("cells that are no parts of the surface's spans")
            places *= (len(points) - 1) * (m + 1)
        if places > LARGEST:
            raise ReplayError(f"more than {LARGEST} places of one face")

    def _at(self, s: Jet, t: Jet) -> tuple[list[Jet], Jet | None]:
        values = run(self._program, s, t)
        return self.surface.height([values[k] for k in self._outputs])

    def interpolant(self) -> tuple[Array, Array]:
        """Return a bound of the interpolant in each cell, and the differences at its nodes."""
        rows = max(1, BLOCK // ((len(self._cells[1]) - 1) * prod(m + 1 for m in self.degrees)))
        found = [self._rows(k, k + rows) for k in range(0, len(self._cells[0]) - 1, rows)]
        total, seen = (np.concatenate(part) for part in zip(*found, strict=True))
        return total, seen

    def _rows(self, first: int, last: int) -> tuple[Array, Array]:
        nodes, rows = [], (self._cells[0][first : last + 1], self._cells[1])
        for points, m in zip(rows, self.degrees, strict=True):
            x = 0.5 - 0.5 * np.cos(pi * np.arange(m + 1) / m)
            nodes.append(points[:-1, None] + np.diff(points)[:, None] * x)
        one = isinstance(self.surface, Spline)  # distances from others may be roots
        rounded = [Jet(x[None], np.full((1, 1, 1) if one else x[None].shape, 4 * UNIT))
                   for x in (nodes[0].reshape(-1, 1), nodes[1].reshape(1, -1))]  # fmt: skip
        found, _ = self._at(*rounded)
        (c, i), (d, j) = nodes[0].shape, nodes[1].shape
        full = c * i, d * j
        gaps = np.stack([np.broadcast_to(jet.c[0], full) for jet in found])
        gaps = gaps.reshape(-1, c, i, d, j).transpose(0, 1, 3, 2, 4)
        radii = np.broadcast_to(sum(jet.r[0] for jet in found), full)
        off = radii.reshape(c, i, d, j).max(axis=(1, 3))
        if isinstance(self.surface, Spline):
            known, more = self.surface.at(*nodes)
            gaps, off = gaps - known, off + more
        a, b = (_chebyshev(m) for m in self.degrees)
        waves = a @ np.ascontiguousarray(gaps) @ b.T
        sums = np.sqrt(np.einsum("k...,k...", waves, waves)).sum(axis=(2, 3))
        seen = np.sqrt(np.einsum("k...,k...", gaps, gaps).max(axis=(2, 3)))
        # what rounding may add to values, and to the coefficients
        off = off * lebesgue(self.degrees[0]) * lebesgue(self.degrees[1])
        return sums + off + 1e-13 * seen, seen

    def remainder(self, axis: int) -> tuple[Array, Jet | None]:
        """Return how far the interpolant along an axis may be off, in each cell."""
        m, jets = self.degrees[axis], []
        for k, shape in enumerate(((-1, 1), (1, -1))):
            points = self._cells[k]
            middle = (0.5 * (points[:-1] + points[1:])).reshape(shape)
            half = (0.5 * np.diff(points) * OUT + 2 * UNIT).reshape(shape)
            order = m + 1 if k == axis else 0
            c, r = np.zeros((2, order + 1, *middle.shape))
            c[0], r[0], c[1:2] = middle, half, half
            jets.append(Jet(c, r))
        found, radius = self._at(jets[0], jets[1])
        rests = [jet.size[m + 1] ** 2 for jet in found if len(jet.c) > m + 1]
        return np.asarray(2.0 ** (1 - m) * np.sqrt(sum(rests, np.zeros((1, 1))))), radius

    def bound(self) -> tuple[float, float]:
        """Return a bound of the distance between side and surface, and the largest one seen.

        On a cell of half length h the interpolant of degree m at Chebyshev's extreme places is off
        by at most 2^(1-m) times the Taylor coefficient m + 1 of x -> M(middle + h x); it is nowhere
        larger than the sum of its own coefficients.
        """
        with np.errstate(all="ignore"):
            total, seen = self.interpolant()
            rest, radius = self.remainder(0)
            total = total + rest + lebesgue(self.degrees[0]) * self.remainder(1)[0]
            total, seen = (self.surface.distance(x, radius) for x in (total, seen))
        largest = float(total.max()) * (1.0 + 1e-9)
        return (largest if largest >= 0.0 else np.inf), float(seen.max())


def lebesgue(m: int) -> float:
    """Return a bound of how much interpolation can enlarge errors of the values."""
    return 1.0 + 2.0 / pi * log(m + 1.0)


def _chebyshev(m: int) -> Array:
    """Return the matrix from values at the extreme places to Chebyshev coefficients."""
    k = np.arange(m + 1)
    ends = np.where((k == 0) | (k == m), 0.5, 1.0)
    signs = (-1.0) ** k[:, None]
    return np.asarray(2.0 / m * ends[:, None] * signs * np.cos(pi * np.outer(k, k) / m) * ends)


def surface_of(file: StepText, face: int, turn: Sequence[bool]) -> Spline | Quadric:
    """Return the surface of a face; raise ReplayError where its kind is not known here."""
    parts = file.get(file.only(face, "ADVANCED_FACE")[2])
    (kind, values), *_ = parts.items()
    if kind in Quadric.KINDS and len(parts) == 1:
        lengths = [float(x) for x in values[2:]]
        if kind == "CONICAL_SURFACE":
            lengths[1] *= file.radian()
        return Quadric(kind, file.frame(values[1]), lengths)
    if list(parts) != ["B_SPLINE_SURFACE_WITH_KNOTS"]:
        raise ReplayError("a surface that is not known here: " + "+".join(parts))
    _, p, q, rows, *_, often_u, often_v, u, v, _ = values
    poles = np.array([[file.point(pole) for pole in row] for row in rows])
    knots = [np.repeat([float(x) for x in values], [int(n) for n in often])
             for values, often in ((u, often_u), (v, often_v))]  # fmt: skip
    return Spline((int(p), int(q)), knots, poles, turn)


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
    text = StepText(file)
    faces, claims = text.require_closed(), certificate["faces"]
    if faces != {int(claim["face"]) for claim in claims}:
        raise ReplayError("the faces of the file's shells are not those of the certificate")
    tolerance, done, largest, rests = float(certificate["tolerance"]), 0, 0.0, Counter[str]()
    for claim in claims:
        name, stated = f"the face #{claim['face']} ({claim['side']})", float(claim["distance"])
        if not stated <= tolerance:
            raise ReplayError(f"{name} is stated {stated:.3g} off, {tolerance:.3g} are allowed")
        rests[claim["rests_on"]] += 1
        for patch in claim["replay"]:
            surface = surface_of(text, int(claim["face"]), patch["turn"])
            found, _ = Difference(patch, surface).bound()
            if not found <= stated * (1.0 + 1e-6):
                raise ReplayError(f"{name}: {found:.3g} is found where {stated:.3g} is stated")
            largest = max(largest, found)
        done += bool(claim["replay"])
    words = ", ".join(f"{count} {how}" for how, count in sorted(rests.items()))
    return [
        f"closed: every edge of {len(faces)} faces is used once in each sense (exact)",
        f"{done} of {len(claims)} faces bounded anew: none further than {largest:.3g} "
        f"{certificate['units']} from its side ({tolerance:.3g} allowed)",
        f"stated, not found again: {len(claims) - done} faces, borders and integrals; the faces "
        f"rest on: {words}",
    ]


def check(names: Sequence[str | Path]) -> tuple[int, list[str]]:
    """Replay a certificate against a file and, where there is a third name, its template.

    Returns 0 where it holds, 6 where not, 2 where something cannot be read, and what to say of it;
    the words may be a stranger's, of the certificate.
    """
    try:
        first, *others = (Path(name).read_bytes() for name in names)
        return 0, ["holds", *(f"  {line}" for line in replay(json.loads(first), *others))]
    except ReplayError as error:
        return 6, [f"does not hold: {error}"]
    except UNREADABLE as error:
        return 2, [f"cannot be read: {type(error).__name__}: {error}"]
