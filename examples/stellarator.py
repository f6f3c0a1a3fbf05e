"""A stellarator: the plasma of a published configuration as a solid, its first wall as a mesh.

    python examples/stellarator.py

Stellarators are given as Fourier sums in a poloidal angle θ and the toroidal angle φ, which is a
point equation already. The coefficients are those of the quasi-helically symmetric configuration
with six field periods by Nührenberg & Zille, Phys. Lett. A 129 (1988) 113, as VMEC's input files
hand them on (metres): R = Σ r cos(mθ - 6nφ), Z = Σ z sin(mθ - 6nφ).

The plasma fills one period from an axis to that surface; the wall stands on it, at equal distances
in every plane φ = const. The plasma's volume is known (188.552389 m³ in all periods); the wall's is
Steiner's formula in those planes.
"""

from __future__ import annotations

import numpy as np

import pc2cad as pc

PERIODS = 6
#: (n, m) -> r, z
SURFACE = {
    (0, 0): (11.0, 0.0), (1, 0): (0.553, 0.395), (2, 0): (0.027, 0.027),
    (-2, 1): (-0.046, 0.046), (-1, 1): (-0.5, 0.5), (0, 1): (0.942, 1.058),
    (1, 1): (0.023, 0.023), (2, 1): (-0.003, -0.003),
    (-2, 2): (0.038, -0.038), (-1, 2): (0.248, 0.248), (0, 2): (0.068, 0.068),
}  # fmt: skip
#: a line from which all of every bean-shaped section can be seen: the magnetic axis will not do
CENTRE = {(0, 0): (11.08, 0.0), (1, 0): (1.1, 0.58), (2, 0): (-0.18, -0.22)}
VOLUME = 188.552389137478
WALL = 0.2

u, v, w = pc.parameters()
theta, phi = 2 * pc.pi * u, 2 * pc.pi * v / PERIODS


def fourier(modes, factor=1):
    """Return the trees of R and Z of a Fourier sum, whose terms may be multiplied by w."""
    angles = {(n, m): m * theta - PERIODS * n * phi for n, m in modes}
    R = sum(modes[key][0] * factor * pc.cos(angle) for key, angle in angles.items())
    Z = sum(modes[key][1] * factor * pc.sin(angle) for key, angle in angles.items())
    return R, Z


def round_the_axis(R, Z):
    return R * pc.cos(phi), R * pc.sin(phi), Z


def plasma():
    (R, Z), (Rc, Zc) = fourier(SURFACE), fourier(CENTRE)
    return round_the_axis(Rc + (R - Rc) * w, Zc + (Z - Zc) * w)


def wall():
    R, Z = fourier(SURFACE)
    dR, dZ = pc.diff(R, u), pc.diff(Z, u)
    length = pc.sqrt(dR**2 + dZ**2)
    return round_the_axis(R + WALL * w * dZ / length, Z - WALL * w * dR / length)


def steiner(count=256):
    """Return the wall's volume in one period: ∫ (R + t n_R)(1 + κt) dt ds dφ, 0 < t < WALL."""
    angles = 2 * np.pi * np.arange(count) / count
    t, p = np.meshgrid(angles, angles / PERIODS, indexing="ij")
    R, dR, ddR, dZ, ddZ = np.zeros((5, count, count))
    for (n, m), (r, z) in SURFACE.items():
        cos, sin = np.cos(m * t - PERIODS * n * p), np.sin(m * t - PERIODS * n * p)
        R += r * cos
        dR, ddR = dR - m * r * sin, ddR - m * m * r * cos
        dZ, ddZ = dZ + m * z * cos, ddZ - m * m * z * sin
    length = np.hypot(dR, dZ)
    bend, outward = (dR * ddZ - dZ * ddR) / length**3, dZ / length
    strip = R * WALL + (outward + R * bend) * WALL**2 / 2 + outward * bend * WALL**3 / 3
    return float((strip * length).mean()) * 4 * np.pi**2 / PERIODS


def main():
    part = pc.compile_part(plasma(), tolerance=5e-3, name="plasma", units="m")
    mesh = pc.mesh_part(wall(), cells=(36, 18, 2), order=2, name="wall", units="m")
    return {
        "volume of the plasma, by its equation": (PERIODS * part.report.equation.volume, VOLUME),
        "volume of the plasma, splines within 5 mm":
            (PERIODS * part.report.solid.volume, VOLUME),
        "volume of the wall, 1296 hexahedra of order 2": (mesh.volume(), steiner()),
    }  # fmt: skip


if __name__ == "__main__":
    for figure, (found, exact) in main().items():
        print(f"{figure}: {found:.9g} m³, exact {exact:.9g} m³")
