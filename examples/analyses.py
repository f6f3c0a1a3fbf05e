"""Finite elements from point equations: problems with known answers.

    python examples/analyses.py

Each function meshes an equation, loads and supports it by the names of its sides, solves it with
CalculiX (``ccx``), scikit-fem or MFEM, and compares with a closed form. Prints a table.
"""

from __future__ import annotations

import numpy as np
from solvers import (
    ELASTIC,
    NU,
    Answer,
    E,
    calculix,
    conductance,
    isogeometric_conductance,
    mesh,
    node_values,
    pressure,
)

import pc2cad as pc
from pc2cad.equation.point_equation import PointEquation, point_equation
from pc2cad.mesh.volume_mesh import VolumeMesh

u, v, w = pc.parameters()


# -- free thermal expansion ------------------------------------------------------------------------


def thermal_expansion(part: VolumeMesh) -> tuple[float, float]:
    """Warm a part that nothing holds; return the relative errors of displacement and stress.

    The displacement is α ΔT (x - x₀) whatever the shape, and there is no stress. Three nodes are
    given that displacement.
    """
    strain = 1e-3 * 100.0
    x = part.points
    a = int(np.argmin(x[:, 0]))
    b = int(np.argmax(((x - x[a]) ** 2).sum(axis=1)))
    along = (x[b] - x[a]) / np.linalg.norm(x[b] - x[a])
    offset = x - x[a] - ((x - x[a]) @ along)[:, None] * along
    c = int(np.argmax((offset**2).sum(axis=1)))
    held = "".join(
        f"{node + 1}, {axis + 1}, {axis + 1}, {strain * (x[node] - x[a])[axis]:.12e}\n"
        for node in (a, b, c)
        for axis in range(3)
    )
    text = calculix(
        part,
        ELASTIC + "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nsolid, 0.\n*STEP\n*STATIC\n"
        f"*TEMPERATURE\nsolid, 100.\n*BOUNDARY\n{held}"
        "*NODE PRINT, NSET=solid\nU\n*EL PRINT, ELSET=solid\nS\n*END STEP\n",
    )
    found = node_values(text, "displacements")
    size = np.linalg.norm(x.max(axis=0) - x.min(axis=0))
    moved = np.array([found[k + 1] for k in range(len(x))])
    displacement = np.abs(moved - strain * (x - x[a])).max() / (strain * size)
    stress = np.array([
        [float(y) for y in line.split()[2:8]]
        for line in text[text.index("stresses") :].splitlines()[2:]
        if len(line.split()) >= 8
    ])  # fmt: skip
    return float(displacement), float(np.abs(stress).max() / (E * strain))


# -- under pressure --------------------------------------------------------------------------------


def hollow_ball(n: int = 4) -> Answer:
    """An eighth of a hollow ball, 1 < r < 2, under inner pressure; symmetry on u=0, u=1, v=1."""
    phi, theta, r = pc.pi / 2 * u, pc.pi / 2 * v, 1 + w
    ball = point_equation(
        (r * pc.sin(theta) * pc.cos(phi), r * pc.sin(theta) * pc.sin(phi), r * pc.cos(theta)),
        name="ball",
    )
    part = mesh(ball, (2 * n, 2 * n, n))
    text = calculix(
        part,
        ELASTIC + "*BOUNDARY\nu_0, 2, 2\nu_1, 1, 1\nv_1, 3, 3\n*STEP\n*STATIC\n"
        f"*DLOAD\n{pressure(part, 'w=0')}*NODE PRINT, NSET=w_0\nU\n*END STEP\n",
    )
    found = _radial(part, text, "w=0", (0, 1, 2))
    a, b = 1.0, 2.0
    factor = a**3 / (E * (b**3 - a**3))
    exact = factor * ((1 - 2 * NU) * a + (1 + NU) * b**3 / (2 * a**2))
    return Answer("hollow ball, inner pressure: radial displacement inside", "CalculiX, C3D20",
                  3 * len(part.points), found, exact,
                  "Lamé; Timoshenko & Goodier §136")  # fmt: skip


def thick_tube(n: int = 3) -> Answer:
    """A quarter of a tube, 1 < r < 2, held at both ends (plane strain), under inner pressure."""
    part = mesh(_quarter_tube(), (2 * n, 1, n))
    text = calculix(
        part,
        ELASTIC + "*BOUNDARY\nu_0, 2, 2\nu_1, 1, 1\nv_0, 3, 3\nv_1, 3, 3\n*STEP\n*STATIC\n"
        f"*DLOAD\n{pressure(part, 'w=0')}*NODE PRINT, NSET=w_0\nU\n*END STEP\n",
    )
    a, b = 1.0, 2.0
    exact = (1 + NU) * a**2 / (E * (b**2 - a**2)) * ((1 - 2 * NU) * a + b**2 / a)
    return Answer("thick tube, inner pressure: radial displacement inside", "CalculiX, C3D20",
                  3 * len(part.points), _radial(part, text, "w=0", (0, 1)), exact,
                  "Lamé; Timoshenko & Goodier §28")  # fmt: skip


def _quarter_tube() -> PointEquation:
    phi, r = pc.pi / 2 * u, 1 + w
    return point_equation((r * pc.cos(phi), r * pc.sin(phi), v), name="tube")


def _radial(part: VolumeMesh, text: str, side: str, axes: tuple[int, ...]) -> float:
    """Return the mean radial displacement of a side's nodes."""
    nodes = part.node_sets[side]
    found = node_values(text, "displacements")
    x = part.points[nodes][:, axes]
    normal = x / np.linalg.norm(x, axis=1)[:, None]
    moved = np.array([found[k + 1] for k in nodes.tolist()])[:, axes]
    return float((moved * normal).sum(axis=1).mean())


# -- beams -----------------------------------------------------------------------------------------


def cantilever(cells: tuple[int, int, int] = (12, 30, 2)) -> Answer:
    """A pipe of radii 0.8 and 1, 20 long, clamped at v=0, loaded across at v=1."""
    phi, r = 2 * pc.pi * u, 0.8 + 0.2 * w
    a, b, length, force = 0.8, 1.0, 20.0, 1e-3
    pipe = point_equation((r * pc.cos(phi), r * pc.sin(phi), length * v), name="pipe")
    part = mesh(pipe, cells)
    ends = part.node_sets["v=1"]
    text = calculix(
        part,
        ELASTIC
        + f"*BOUNDARY\nv_0, 1, 3\n*STEP\n*STATIC\n*CLOAD\nv_1, 1, {force / len(ends):.12e}\n"
        "*NODE PRINT, NSET=v_1\nU\n*END STEP\n",
    )
    found = np.mean([row[0] for row in node_values(text, "displacements").values()])
    inertia, area, m = np.pi / 4 * (b**4 - a**4), np.pi * (b**2 - a**2), a / b
    shear = 6 * (1 + NU) * (1 + m**2) ** 2 / (
        (7 + 6 * NU) * (1 + m**2) ** 2 + (20 + 12 * NU) * m**2
    )  # fmt: skip
    modulus = E / (2 * (1 + NU))
    exact = force * length**3 / (3 * E * inertia) + force * length / (shear * modulus * area)
    return Answer("cantilever pipe: deflection of the end", "CalculiX, C3D20",
                  3 * len(part.points), float(found), exact,
                  "Timoshenko beam, shear coefficient of Cowper 1966")  # fmt: skip


def cantilever_channel(cells: tuple[int, int, int] = (30, 16, 2)) -> Answer:
    """The paper's elliptic section and wall along a straight guide, clamped at u=0, loaded at u=1.

    The wall is measured along KN, so that the section lies between two curves, neither an ellipse;
    its area and moment of inertia are integrals of the equation. The load is along its short axis.
    """
    a, b, wall, length, force = 2.0, 1.2, 0.4, 40.0, 1e-3
    N = pc.points(O=(0, 0, 0), L=(0, 0, length))
    guide = N[0] * (1 - u) + N[1] * u
    part = mesh(pc.channel(guide, pc.ellipse(a, b, v), wall, side="centred"), cells)
    ends = part.node_sets["u=1"]
    x, y = part.points[ends].T[:2]
    across = int(np.argmin((np.ptp(x), np.ptp(y))))
    text = calculix(
        part,
        ELASTIC + "*BOUNDARY\nu_0, 1, 3\n*STEP\n*STATIC\n*CLOAD\n"
        f"u_1, {across + 1}, {force / len(ends):.12e}\n*NODE PRINT, NSET=u_1\nU\n*END STEP\n",
    )
    found = np.mean([row[across] for row in node_values(text, "displacements").values()])
    area, inertia, shear = _section(a, b, wall)
    modulus = E / (2 * (1 + NU))
    exact = force * length**3 / (3 * E * inertia) + force * length / (shear * modulus * area)
    return Answer("cantilever channel: deflection of the end", "CalculiX, C3D20",
                  3 * len(part.points), float(found), exact,
                  "Timoshenko beam, shear of a thin closed section")  # fmt: skip


def _section(a: float, b: float, wall: float) -> tuple[float, float, float]:
    """Return area, moment of inertia and shear share of an elliptic section with its wall along KN.

    For a load along b: the shear flow q of a thin closed section, which is 0 where it meets that
    axis, has the energy of the share, V²/(share A G) = ∮ q²/(G t) ds.
    """
    t, weight = np.polynomial.legendre.leggauss(400)
    t, weight = np.pi * (t + 1), np.pi * weight
    x, y = a * np.cos(t), b * np.sin(t)
    r = np.hypot(x, y)
    turn = a * b / r**2  # of the polar angle over t
    inner, outer = r - wall / 2, r + wall / 2
    area = float(((outer**2 - inner**2) / 2 * turn) @ weight)
    inertia = float(((outer**4 - inner**4) / 4 * (y / r) ** 2 * turn) @ weight)
    speed = np.hypot(a * np.sin(t), b * np.cos(t))
    thickness = wall * r * turn / speed  # of the wall along its normal, nearly
    order = np.argsort(t)
    moment = np.zeros_like(t)
    # static moment over t, less what it is at a quarter turn, where the flow is 0
    flow = y * thickness * speed * weight
    moment[order] = np.cumsum(flow[order]) - flow[order] / 2
    quarter = float(flow[t < np.pi / 2].sum())
    energy = float((((moment - quarter) / inertia) ** 2 / thickness * speed) @ weight)
    return area, inertia, 1 / (area * energy)


def torsion(n: int = 4) -> Answer:
    """An elliptical rod of half-axes 2 and 1, twisted; its ends are free to warp."""
    a, b, length, twist = 2.0, 1.0, 3.0, 1e-3
    phi = 2 * pc.pi * u
    rod = point_equation((a * w * pc.cos(phi), b * w * pc.sin(phi), length * v), name="rod")
    part = mesh(rod, (8 * n, n, n))
    x = part.points
    ends = "".join(
        f"{k + 1}, 1, 1, {-twist * x[k, 1]:.12e}\n{k + 1}, 2, 2, {twist * x[k, 0]:.12e}\n"
        for k in part.node_sets["v=1"].tolist()
    )
    axis = int(np.argmin(x[:, 0] ** 2 + x[:, 1] ** 2 + x[:, 2] ** 2)) + 1
    text = calculix(
        part,
        ELASTIC + f"*BOUNDARY\nv_0, 1, 2\n{axis}, 3, 3\n*STEP\n*STATIC\n*BOUNDARY\n{ends}"
        "*NODE PRINT, NSET=v_1\nRF\n*END STEP\n",
    )
    force = node_values(text, "forces")
    found = sum(x[k - 1, 0] * f[1] - x[k - 1, 1] * f[0] for k, f in force.items())
    stiffness = np.pi * a**3 * b**3 / (a**2 + b**2) * E / (2 * (1 + NU))
    return Answer("torsion of an elliptical rod: torque", "CalculiX, C3D20 and C3D15",
                  3 * len(x), float(found), stiffness * twist / length,
                  "Saint-Venant; Timoshenko & Goodier §105")  # fmt: skip


# -- heat ------------------------------------------------------------------------------------------


def heat_in_calculix(n: int = 3) -> Answer:
    part = mesh(_quarter_tube(), (2 * n, 1, n))
    return Answer("conduction through a tube's wall: heat flow", "CalculiX, C3D20",
                  len(part.points), conductance(part), np.pi / 2 / np.log(2),
                  "2πkL/ln(b/a); Carslaw & Jaeger §7.2")  # fmt: skip


def heat_in_scikit_fem(n: int = 12) -> Answer:
    """The same by scikit-fem, which takes the sides' names from the .msh file."""
    import skfem
    from skfem.models.poisson import laplace

    part = mesh(_quarter_tube(), (2 * n, 1, n), order=1)
    grid = part.to_skfem()
    basis = skfem.Basis(grid, skfem.ElementHex1())
    stiffness = laplace.assemble(basis)
    hot, cold = basis.get_dofs("w=1").all(), basis.get_dofs("w=0").all()
    temperature = np.zeros(basis.N)
    temperature[hot] = 1.0
    temperature = skfem.solve(*skfem.condense(
        stiffness, x=temperature, D=np.concatenate((hot, cold))
    ))  # fmt: skip
    return Answer("conduction through a tube's wall: heat flow", "scikit-fem, hexahedra of order 1",
                  basis.N, float(temperature @ (stiffness @ temperature)), np.pi / 2 / np.log(2),
                  "2πkL/ln(b/a); Carslaw & Jaeger §7.2")  # fmt: skip


def heat_in_mfem() -> Answer:
    unknowns, found = isogeometric_conductance(_quarter_tube(), refinements=1, raised=2)
    return Answer("conduction through a tube's wall: heat flow", "MFEM, NURBS",
                  unknowns, found, np.pi / 2 / np.log(2),
                  "2πkL/ln(b/a); Carslaw & Jaeger §7.2")  # fmt: skip


ANALYSES = (
    hollow_ball, thick_tube, cantilever, cantilever_channel, torsion, heat_in_calculix,
    heat_in_scikit_fem, heat_in_mfem,
)  # fmt: skip


def main() -> None:
    print("| problem | solver | unknowns | found | exact | error | reference |")
    print("|---|---|---|---|---|---|---|")
    for analysis in ANALYSES:
        a = analysis()
        print(f"| {a.problem} | {a.solver} | {a.unknowns} | {a.found:.8g} | {a.exact:.8g} | "
              f"{a.error:.1e} | {a.source} |")  # fmt: skip


if __name__ == "__main__":
    main()
