"""The solids: channels with a wall, as pc2cad templates and as functions worked out by hand.

The functions are what a user of the other routes would write: with the math module for one point,
with NumPy for a grid. `check` holds both against the template before anything is measured.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from itertools import count

import numpy as np

from pc2cad.domain.map import local_map
from pc2cad.equation.point_equation import PointEquation
from pc2cad.templates.file import parse_template

#: values of (u, v) at a limit of w: three floats for floats, (n, 3) for arrays (n,)
Vector = tuple[float, float, float]

_FRENET = """
[let]
N = "{guide}"
P = "N + diff(N, u)"
E = "N + diff(diff(N, u), u)"
N1 = "E - (P-N)*metric(E, P, N)/metric(P, P, N)"
R = "N + unit(N1-N)"
Q = "N + unit(exit_from_plane(N, P, N1)-N)"
K = "N + (R-N)*{a}*cos(2*pi*v) + (Q-N)*{b}*sin(2*pi*v)"
[solid]
M = "K + (K-N)*{delta}/distance(K, N)*(w - 1/2)"
"""


_NUMBERS = count(1)


@dataclass(frozen=True)
class Channel:
    """A section with semi-axes a and b, a wall centred on it, along a guide in its Frenet frame."""

    name: str
    about: str
    text: str
    a: float
    b: float
    delta: float
    #: N, N' and N'' at u with the functions of a module (math or numpy)
    guide: Callable[[object, object], tuple[tuple, tuple, tuple]]
    #: the same channel with every length times a factor
    scaled: Callable[[float], Channel]

    def another(self) -> Channel:
        """Return the channel a millionth or so larger, as no call before has returned it.

        A program that remembers what it worked out finds none of these numbers again.
        """
        return self.scaled(1 + 1e-6 * next(_NUMBERS))

    def equation(self) -> PointEquation:
        return parse_template(self.text, self.name).bind({})

    def point(self, w: float) -> Callable[[float, float], Vector]:
        """Return the wall at w as a function of single numbers u and v."""
        a, b, thicker = self.a, self.b, self.delta * (w - 0.5)
        guide = self.guide

        def at(u: float, v: float) -> Vector:
            (nx, ny, nz), (dx, dy, dz), (sx, sy, sz) = guide(math, u)
            along = (dx * sx + dy * sy + dz * sz) / (dx * dx + dy * dy + dz * dz)
            sx, sy, sz = sx - along * dx, sy - along * dy, sz - along * dz
            length = math.sqrt(sx * sx + sy * sy + sz * sz)
            sx, sy, sz = sx / length, sy / length, sz / length
            bx, by, bz = dy * sz - dz * sy, dz * sx - dx * sz, dx * sy - dy * sx
            length = math.sqrt(bx * bx + by * by + bz * bz)
            bx, by, bz = bx / length, by / length, bz / length
            x, y = a * math.cos(2 * math.pi * v), b * math.sin(2 * math.pi * v)
            wider = 1 + thicker / math.sqrt(x * x + y * y)
            x, y = x * wider, y * wider
            return (nx + x * sx + y * bx, ny + x * sy + y * by, nz + x * sz + y * bz)

        return at

    def guide_points(self, u: np.ndarray) -> np.ndarray:
        return np.stack([c + 0 * u for c in self.guide(np, u)[0]], axis=-1)

    def points(self, w: float, u: np.ndarray, v: np.ndarray) -> np.ndarray:
        """Return the wall at w on arrays u and v that broadcast: shape + (3,)."""
        place, first, second = (
            np.stack([c + 0 * u for c in part], axis=-1) for part in self.guide(np, u)
        )
        along = (first * second).sum(-1, keepdims=True) / (first * first).sum(-1, keepdims=True)
        normal = second - along * first
        normal /= np.linalg.norm(normal, axis=-1, keepdims=True)
        binormal = np.cross(first, normal)
        binormal /= np.linalg.norm(binormal, axis=-1, keepdims=True)
        x, y = self.a * np.cos(2 * np.pi * v), self.b * np.sin(2 * np.pi * v)
        wider = 1 + self.delta * (w - 0.5) / np.hypot(x, y)
        x, y = (x * wider)[..., None], (y * wider)[..., None]
        return place + x * normal + y * binormal

    def grid(self, w: float, n: int) -> np.ndarray:
        """Return (n + 1) × (n + 1) points of the wall at w, as the routes by points want them."""
        t = np.linspace(0, 1, n + 1)
        return self.points(w, t[:, None], t[None, :])

    def check(self) -> None:
        """Raise ValueError where the functions are not the template's map."""
        generator = np.random.default_rng(3)
        u, v = generator.uniform(size=(2, 50))
        for w in (0.0, 1.0):
            true = local_map(self.equation()).points(u, v, np.full_like(u, w))
            gap = np.abs(self.points(w, u, v) - true).max()
            single = np.array([self.point(w)(*uv) for uv in zip(u.tolist(), v.tolist())])  # noqa: B905
            if max(gap, np.abs(single - true).max()) > 1e-11 * (1 + np.abs(true).max()):
                raise ValueError(f"{self.name}: the functions are not the template's: {gap}")


def _paper_guide(a: float, b: float, c: float) -> Callable[[object, object], tuple]:
    def guide(m, u):
        s, k = m.sin(u), m.cos(u)
        return (
            (a * u**3, b * (1 - u) ** 3, c * s),
            (3 * a * u**2, -3 * b * (1 - u) ** 2, c * k),
            (6 * a * u, 6 * b * (1 - u), -c * s),
        )

    return guide


def _helix_guide(radius: float, pitch: float, turns: float) -> Callable[[object, object], tuple]:
    turn, rise = 2 * math.pi * turns, pitch * turns

    def guide(m, u):
        k, s = radius * m.cos(turn * u), radius * m.sin(turn * u)
        return (
            (k, s, rise * u),
            (-turn * s, turn * k, rise),
            (-(turn**2) * k, -(turn**2) * s, 0 * u),
        )

    return guide


def _channel(name, about, a, b, delta, guide, text_guide, scaled, points=""):
    head = f'title = "{about}"\n{points}'
    text = head + _FRENET.format(guide=text_guide, a=a, b=b, delta=delta)
    return Channel(name, about, text, a, b, delta, guide, scaled)


def along_paper(name, about, a, b, delta, size) -> Channel:
    x, y, z = size
    points = f"[points]\nA = [{x}, 0, 0]\nB = [0, {y}, 0]\nC = [0, 0, {z}]\nD = [0, 0, 0]\n"
    text = "(A-D)*u^3 + (B-D)*(1-u)^3 + (C-D)*sin(u) + D"

    def scaled(k):
        return along_paper(name, about, a * k, b * k, delta * k, (x * k, y * k, z * k))

    return _channel(name, about, a, b, delta, _paper_guide(*size), text, scaled, points)


def along_helix(name, about, a, b, delta, radius, pitch, turns) -> Channel:
    t = f"2*pi*{turns}*u"
    text = f"point({radius}*cos({t}), {radius}*sin({t}), {pitch}*{turns}*u)"

    def scaled(k):
        return along_helix(name, about, a * k, b * k, delta * k, radius * k, pitch * k, turns)

    return _channel(name, about, a, b, delta, _helix_guide(radius, pitch, turns), text, scaled)


CHANNELS = (
    along_paper("paper", "ellipse 12 x 8, wall 2, on the paper's guide 100, 80, 60",
                12, 8, 2, (100, 80, 60)),
    along_helix("helix", "ellipse 10 x 6, wall 2, two turns of R 50, pitch 30",
                10, 6, 2, 50, 30, 2),
    along_paper("8a", "ellipse 2 x 1.2, wall 0.4, on the paper's guide 10, 10, 10",
                2, 1.2, 0.4, (10, 10, 10)),
    along_helix("A16", "tube of radii 0.5 and 1, two turns of R 4, pitch 3",
                0.75, 0.75, 0.5, 4, 3, 2),
)  # fmt: skip
