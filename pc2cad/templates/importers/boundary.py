"""The boundary of a stellarator or tokamak: its figures, and a line that sees all of it.

The plasma is drawn from a line round the machine from which all of every section is seen. It is
sought by linear programming: its distances from the tangents of the sections are linear in its
Fourier coefficients, and the least of them is made as large as can be.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from fractions import Fraction
from typing import TYPE_CHECKING, Final

from pc2cad.errors import InputError
from pc2cad.expression.waves import Waves, series

if TYPE_CHECKING:
    from pc2cad.arrays import Array

#: tables of coefficients: of R with cosines and sines, of Z with both
TABLES: Final = ("rbc", "rbs", "zbc", "zbs")
#: harmonics of the line from which the plasma is drawn: as few as do
HARMONICS: Final = (0, 1, 2, 3, 4, 6)
#: angles at which the sections are looked at
PLACES: Final = (120, 48)
#: a line that sees the sections from this share of the surface's height is good enough
SIGHT: Final = 0.05


@dataclass(frozen=True)
class Surface:
    """A closed surface R(θ, φ), Z(θ, φ) that repeats `periods` times round the axis (metres)."""

    periods: int
    #: rows (m, n, coefficient) of RBC, RBS, ZBC and ZBS
    waves: Mapping[str, list[tuple[int, int, Fraction]]] = field(repr=False)

    @property
    def series(self) -> tuple[Waves, Waves]:
        """R and Z."""
        return (
            series(self.periods, self.waves["rbc"], self.waves["rbs"]),
            series(self.periods, self.waves["zbc"], self.waves["zbs"]),
        )


def volume_and_area(surface: Surface) -> tuple[float, float]:
    """Return the volume within all periods of the surface, and its area (m³, m²).

    V = ½ ∮∮ R² Z_θ dθ dφ; sums over even angles are exact as soon as these are more than the waves.
    """
    import numpy as np

    from pc2cad.expression.wave_values import jet

    theta, phi = _angles(surface, (512, 512))
    rows = [dict(jet(waves, theta, phi, ((0, 0), (1, 0), (0, 1)))) for waves in surface.series]
    (r, r_t, r_p), (_, z_t, z_p) = ([row[o] + 0 * theta + 0 * phi for o in ((0, 0), (1, 0), (0, 1))]
                                    for row in rows)  # fmt: skip
    volume = abs(float((r * r * z_t).mean())) * 2 * np.pi**2
    across = r_t * z_p - z_t * r_p
    area = float(np.sqrt(r * r * (r_t**2 + z_t**2) + across**2).mean()) * 4 * np.pi**2
    return volume, area


def _angles(surface: Surface, places: tuple[int, int]) -> tuple[Array, Array]:
    """Return even angles θ (n, 1) and φ (1, m) of one period."""
    import numpy as np

    theta = 2 * np.pi * np.arange(places[0])[:, None] / places[0]
    phi = 2 * np.pi * np.arange(places[1])[None, :] / places[1] / surface.periods
    return theta, phi


def _sections(surface: Surface) -> tuple[Array, Array, Array, Array, float]:
    """Return R, Z and the outward normals of the sections at places, and the way they run round."""
    import numpy as np

    from pc2cad.expression.wave_values import jet

    theta, phi = _angles(surface, PLACES)
    rows = [dict(jet(waves, theta, phi, ((0, 0), (1, 0)))) for waves in surface.series]
    (r, r_t), (z, z_t) = ([np.broadcast_to(row[o], PLACES) for o in ((0, 0), (1, 0))]
                          for row in rows)  # fmt: skip
    way = float(np.sign((r * z_t).sum()))
    size = np.hypot(r_t, z_t)
    if not way or not (size > 0).all() or not (r > 0).all():
        raise InputError("the boundary is no surface: its sections are flat, or meet the axis")
    return r, z, way * z_t / size, -way * r_t / size, way


def way_round(surface: Surface) -> float:
    """Return 1 where the sections run round with their inside on the left of (R, Z), else -1."""
    return _sections(surface)[4]


def line_of_sight(surface: Surface) -> dict[str, list[tuple[int, int, Fraction]]]:
    """Return waves of a closed line from which all of every section is seen; InputError if none."""
    import numpy as np
    from scipy.optimize import linprog

    r, z, n_r, n_z, _ = _sections(surface)
    _, phi = _angles(surface, PLACES)
    symmetric = not (surface.waves["rbs"] or surface.waves["zbc"])
    enough = SIGHT * float(np.ptp(z))
    best: tuple[float, list[tuple[str, int]], Array] | None = None
    for count in HARMONICS:
        names = [("rbc", n) for n in range(count + 1)] + [("zbs", n) for n in range(1, count + 1)]
        if not symmetric:
            names += [("rbs", n) for n in range(1, count + 1)]
            names += [("zbc", n) for n in range(count + 1)]
        columns = []
        for name, n in names:
            wave = (np.cos if name[2] == "c" else np.sin)(-n * surface.periods * phi)
            columns.append(((n_r if name[0] == "r" else n_z) * wave).ravel())
        # the distance from every tangent is at least the last unknown, which is to be large
        table = np.stack([*columns, np.ones(r.size)], axis=1)
        goal = np.zeros(len(names) + 1)
        goal[-1] = -1.0
        limits = (r * n_r + z * n_z).ravel()
        found = linprog(goal, A_ub=table, b_ub=limits, bounds=[(None, None)] * len(goal))
        if found.status == 0 and (best is None or -found.fun > best[0]):
            best = -found.fun, names, found.x[:-1]
        if best is not None and best[0] >= enough:
            break
    if best is None or best[0] <= 0:
        raise InputError(
            "the sections cannot all be seen from one line, so that the plasma is not filled from "
            "one; give layers, which stand on the boundary"
        )
    digits = max(3, 3 - int(np.floor(np.log10(best[0]))))
    result: dict[str, list[tuple[int, int, Fraction]]] = {name: [] for name in TABLES}
    for (name, n), value in zip(best[1], best[2].tolist(), strict=True):
        result[name].append((0, n, Fraction(repr(round(value, digits)))))
    return result
