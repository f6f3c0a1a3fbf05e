"""Jobs for CalculiX: what they say, what is refused, and what the solver finds with them."""

from __future__ import annotations

import math
import re
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import pc2cad as pc
from pc2cad.cli.main import main
from pc2cad.compiler import mesh_equation
from pc2cad.errors import InputError
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.mesh.results import Results, read_results

QUARTER = """
title = "Quarter of a thick tube"
[domain]
u = [0, "1/4"]
[solid]
x = "(1 + w)*cos(2*pi*u)"
y = "(1 + w)*sin(2*pi*u)"
z = "v/2"
"""
BAR = 'title = "Bar"\n[solid]\nx = "7*u"\ny = "v"\nz = "w"\n'
PLANE_STRAIN = ["--fix", "u=0:y", "--fix", "u=0.25:x", "--fix", "v=0:z", "--fix", "v=1:z"]
needs_ccx = pytest.mark.skipif(
    shutil.which("ccx") is None, reason="CalculiX is not installed (apt-get install calculix-ccx)"
)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name, text in (("tube", QUARTER), ("bar", BAR)):
        Path(f"{name}.toml").write_text(text)
    return tmp_path


def job(part: str, *arguments: str) -> str:
    assert main(["mesh", part, "-o", "job.inp", "--quiet", *arguments]) == 0
    return Path("job.inp").read_text()


def solved(part: str, *arguments: str) -> Results:
    job(part, *arguments)
    done = subprocess.run(["ccx", "-i", "job"], capture_output=True, text=True, check=False)
    assert "*ERROR" not in done.stdout, done.stdout[-2000:]
    return read_results("job.frd")


FIELDS = """
[fields]
stiff = "1000*(1 + x/7)"
heat = "100*z^2"
way = "vector(1, 0, 0)"
"""


def graded_bar() -> str:
    Path("graded.toml").write_text(BAR + FIELDS)
    return "graded.toml"


# -- what a job says -------------------------------------------------------------------------------


def test_a_static_job_has_elements_supports_and_a_pressure_on_every_face(here: Path) -> None:
    text = job(
        "bar.toml", "--cells", "3x2x2", "--deck", "static", "--material", "E=210e3,nu=0.3",
        "--fix", "u=0", "--fix", "v=0:y", "--pressure", "w=1:2.5",
    )  # fmt: skip
    assert "*ELEMENT, TYPE=C3D20R, ELSET=solid" in text
    assert "*ELASTIC\n210000.0, 0.3\n*SOLID SECTION, ELSET=solid" in text
    assert "*BOUNDARY\nu_0, 1, 1\nu_0, 2, 2\nu_0, 3, 3\nv_0, 2, 2\n*STEP\n*STATIC\n" in text
    assert len(re.findall(r"(?m)^\d+, P2, 2\.5$", text)) == 6
    assert text.endswith("*NODE FILE\nU, RF\n*EL FILE\nS\n*END STEP\n")


@pytest.mark.parametrize(
    ("arguments", "element"),
    [((), "C3D20R"), (("--order", "1"), "C3D8I"), (("--element", "C3D20"), "C3D20")],
)
def test_elements_follow_from_what_is_said(
    here: Path, arguments: tuple[str, ...], element: str
) -> None:
    frequency = ("--deck", "frequency", "--material", "E=1,nu=0,rho=1", "--modes", "3")
    text = job("bar.toml", "--cells", "2x1x1", *frequency, *arguments)
    assert f"TYPE={element}," in text
    assert "*DENSITY\n1.0\n" in text
    assert "*FREQUENCY\n3\n" in text


def test_layers_have_materials_of_their_own() -> None:
    u, v, w = pc.parameters()
    mesh = pc.mesh_part((u, v, w), cells=(1, 1, 2), order=2)
    steel, other = pc.Material(E=210e3, nu=0.3), pc.Material(E=70e3, nu=0.33)
    with pytest.raises(InputError, match="no layer is called 'low': the part has none"):
        pc.write_deck(mesh, "no.inp", pc.Deck("static", {"": steel, "low": other}, {"u=0": "xyz"}))
    assert not Path("no.inp").exists()


def test_materials_of_layers_are_sections_of_their_elements(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    text = job(
        "layered_pipe", "--cells", "4x8x3", "--deck", "static", "--fix", "u=0",
        "--material", "E=1e3,nu=0.3", "--material", "pipe:E=210e3,nu=0.3",
    )  # fmt: skip
    sections = re.findall(r"\*SOLID SECTION, ELSET=(\w+), MATERIAL=(\w+)", text)
    assert sorted(sections) == [
        ("inner", "material_1"), ("outer", "material_1"), ("pipe", "material_2"),
    ]  # fmt: skip


def test_a_material_that_is_a_field_has_a_section_for_each_bin(here: Path) -> None:
    """Seven cells in seven bins: the values are those in the middles of the cells."""
    text = job(
        graded_bar(), "--cells", "7x1x1", "--deck", "static", "--fix", "u=0", "--bins", "7",
        "--material", "E=stiff,nu=0.3,alpha=1e-5", "--warm", "heat",
    )  # fmt: skip
    section = r"\*ELASTIC\n(\S+), 0\.3\n\*EXPANSION\n1e-05\n\*ELSET, ELSET=\w+\n(\d+)"
    exact = [(1000 * (1 + (k + 0.5) / 7), k + 1) for k in range(7)]
    found = [(float(E), int(n)) for E, n in re.findall(section, text)]
    np.testing.assert_allclose(found, exact, rtol=1e-14)
    assert text.count("*SOLID SECTION") == 7
    assert "*INITIAL CONDITIONS, TYPE=TEMPERATURE\nsolid, 0.\n" in text
    block = text.partition("*TEMPERATURE\n")[2].partition("*")[0]
    nodes = re.search(r"NSET=solid\n(.*?)\n\*", text, re.S)
    assert nodes is not None
    height = [float(line.split(",")[3]) for line in nodes[1].splitlines()]
    warm = [float(line.split(",")[1]) for line in block.splitlines()]
    assert len(warm) > 20
    np.testing.assert_allclose(warm, 100 * np.array(height) ** 2, rtol=1e-13)


STATIC = ("--deck", "static", "--material", "E=1,nu=0.3")
REFUSED = {
    "nothing holds the part along x and y and z": STATIC,
    "nothing holds the part along y": (*STATIC, "--fix", "u=0:xz"),
    "no field is called 'soft'": ("--deck", "static", "--material", "E=soft,nu=0", "--fix", "u=0"),
    "needs alpha": (*STATIC, "--fix", "u=0", "--warm", "u"),
    "into 1 to 1000 bins": (*STATIC, "--fix", "u=0", "--bins", "0"),
    "no side is called 'u=7'": (*STATIC, "--fix", "u=0", "--pressure", "u=7:1"),
    "held along x, y or z": (*STATIC, "--fix", "u=0:q"),
    "needs rho": ("--deck", "frequency", "--material", "E=1,nu=0.3"),
    "nu lies between": ("--deck", "static", "--material", "E=1,nu=0.5"),
    "each once": ("--deck", "static", "--material", "E=1,E=2"),
    "is no number": (*STATIC, "--fix", "u=0", "--pressure", "w=0:nan"),
    "write a side and a value": (*STATIC, "--fix", "u=0", "--pressure", "1"),
    "has no pressures": ("--deck", "heat", "--material", "k=1", "--pressure", "w=0:1"),
    "no side has a temperature": ("--deck", "heat", "--material", "k=1"),
    "belongs to a job": ("--fix", "u=0"),
    "belongs to --deck frequency": (*STATIC, "--fix", "u=0", "--modes", "3"),
    "there is no material": ("--deck", "static", "--fix", "u=0"),
    "leave --order and --tetrahedra out": (*STATIC, "--fix", "u=0", "--element", "C3D8I",
                                           "--order", "2"),
}  # fmt: skip


@pytest.mark.parametrize("words", REFUSED)
def test_what_is_amiss_is_one_sentence_and_no_file(
    here: Path, words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["mesh", "bar.toml", "--cells", "1x1x1", "-o", "job.inp", *REFUSED[words]]) == 2
    complaint = capsys.readouterr().err.splitlines()[-1]
    assert words in complaint
    assert not (here / "job.inp").exists()


# -- results ---------------------------------------------------------------------------------------

FRD = """    1C
    2C                             2                                     1
 -1         1 0.00000E+00 1.00000E+00 2.00000E+00
 -1         3-1.00000E+00 0.50000E+00 2.50000E-03
 -3
    3C                             0                                     1
 -3
    1PSTEP                         1           1           1
  100CL  101 0.250000000           2                     0    1           1
 -4  DISP        4    1
 -5  D1          1    2    1    0
 -5  D2          1    2    2    0
 -5  D3          1    2    3    0
 -5  ALL         1    2    0    0    1ALL
 -1         3 3.00000E+00-4.00000E+00 5.00000E-12
 -3
 9999
"""


def test_results_are_read_by_columns(tmp_path: Path) -> None:
    path = tmp_path / "a.frd"
    path.write_text(FRD)
    found = read_results(path)
    assert found.points.tolist() == [[0, 1, 2], [-1, 0.5, 0.0025]]
    (step,) = found.steps
    assert (step.value, step.components["DISP"]) == (0.25, ("D1", "D2", "D3"))
    assert step.fields["DISP"][1].tolist() == [3, -4, 5e-12]
    assert np.isnan(step.fields["DISP"][0]).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "has no nodes"),
        ("solid\nfacet\n", "has no nodes"),
        (FRD.replace("-4.00000E+00", "-4.0000xE+00"), "line 15 is none of a file .frd"),
        (FRD.replace(" -1         3 3.0", " -1         7 3.0"), "of nodes that the file has not"),
    ],
)
def test_what_is_no_file_of_results_is_refused(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "a.frd"
    path.write_text(text)
    with pytest.raises(InputError, match=words):
        read_results(path)


def test_numbers_fit_into_what_calculix_reads(here: Path) -> None:
    """It reads 20 characters of a number: -9.556671182132171e-05 has one more."""
    Path("small.toml").write_text(BAR + '[fields]\nway = "-9.556671182132171e-5*(1 + x/7)"\n')
    text = job(
        "small.toml", "--cells", "1x1x1", "--deck", "static", "--material", "E=1,nu=0.3",
        "--fix", "u=0", "--move", "u=1:x:way", "--move", "u=1:y:-9.556671182132171e-05",
    )  # fmt: skip
    step = text.partition("*STEP")[2]
    rows = re.findall(r"(?m)^(\w+), ([12]), \2, (\S+)$", step)
    assert len(rows) == 9
    assert all(len(value) <= 20 for _, _, value in rows)
    exact = [-9.556671182132171e-5 * (2 if axis == "1" else 1) for _, axis, _ in rows]
    np.testing.assert_allclose([float(value) for *_, value in rows], exact, rtol=1e-12)


def test_a_guide_turns_the_axes_of_a_material() -> None:
    """A tube along a helix: the direction is N'(u), whatever the section does on the way."""
    u, v, _ = pc.parameters()
    helix = pc.helix(5, 4, 1)
    section = ((1 + u) * pc.cos(2 * pc.pi * v), pc.sin(2 * pc.pi * v))
    mesh = mesh_equation(pc.channel(helix, section, 0.2), MeshOptions(cells=(12, 6, 1)))[0]
    assert mesh.columns is not None
    assert mesh.columns.directions == ("u", "v", "w", "guide")
    (kind,) = mesh.blocks
    at = 2 * np.pi * mesh.columns.in_elements("u", kind)[:, 0]
    exact = np.stack((-10 * np.pi * np.sin(at), 10 * np.pi * np.cos(at), 0 * at + 4), axis=1)
    found = mesh.columns.directed("guide", kind)
    assert len(found) == 72
    np.testing.assert_allclose(found, exact, atol=1e-12)
    along = mesh.columns.directed("u", kind)
    assert np.abs(along - found).max() > 0.1


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--orient", "u"), "write two directions"),
        (("--orient", "u,u"), "takes two directions, and not u twice"),
        (("--orient", "u,heat"), "no direction is called 'heat': there are u, v, w, way"),
        (("--orient", "u,way"), "have no two directions in the element 1"),
        (("--move", "u=1"), "write a side, x, y or z"),
        (("--move", "u=1:q:1"), "is moved along x, y or z"),
        (("--move", "u=0:x:1"), "along which it is not held"),
        (("--move", "u=1:x:way"), "the field way is no scalar"),
        (("--move", "u=9:x:1"), "no side is called 'u=9'"),
        (("--material", "E1=3"), "needs E2, E3, nu12"),
        (("--fix", "v=0:x", "--fix", "v=0:y"), "--fix v=0 is given twice"),
        (("--move", "u=1:x:1", "--move", "u=1:x:2"), "--move u=1:x is given twice"),
        (("--pressure", "u=1:1", "--pressure", "u=1:2"), "--pressure u=1 is given twice"),
        (("--grade", "w=2", "--grade", "w=3"), "--grade w is given twice"),
    ],
)
def test_axes_and_moves_that_cannot_be_are_refused(
    here: Path, capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], words: str
) -> None:
    material = () if "--material" in arguments else ("--material", "E=1,nu=0.3")
    given = ["--cells", "1x1x1", "--deck", "static", *material, "--fix", "u=0", *arguments]
    assert main(["mesh", graded_bar(), "-o", "job.inp", "--quiet", *given]) == 2
    assert words in capsys.readouterr().err
    assert not Path("job.inp").exists()


@pytest.mark.parametrize(
    ("ratios", "stable"),
    [
        ((0.3, 0.3, 0.3), True),
        ((1.9, 0, 0), True),  # below the root of E1/E2
        ((2.1, 0, 0), False),
        ((0, -2.1, 0), False),
        ((0, 0, 1.01), False),
        ((1.2, 1.2, 0.6), False),  # each by itself is below its root
        ((1.2, 1.2, -0.6), True),
    ],
)
def test_an_orthotropic_material_stores_energy(
    ratios: tuple[float, float, float], stable: bool
) -> None:
    """Its compliances are a positive definite matrix, or it is no material."""
    E1, E2, E3 = 4.0, 1.0, 1.0
    a, b, c = ratios
    compliance = np.array([
        [1 / E1, -a / E1, -b / E1], [-a / E1, 1 / E2, -c / E2], [-b / E1, -c / E2, 1 / E3]
    ])  # fmt: skip
    assert (np.linalg.eigvalsh(compliance).min() > 0) == stable
    given = {"E1": E1, "E2": E2, "E3": E3, "nu12": a, "nu13": b, "nu23": c}
    if stable:
        assert pc.Material(**given).nu12 == a
    else:
        with pytest.raises(InputError, match="elastic energy would be negative"):
            pc.Material(**given)


# -- solved ----------------------------------------------------------------------------------------


@needs_ccx
@pytest.mark.interop
@pytest.mark.parametrize(
    ("element", "most"),
    [("C3D20R", 2e-5), ("C3D20", 2e-5), ("C3D8I", 2e-2), ("C3D10", 3e-3), ("C3D4", 8e-2)],
)
def test_a_thick_tube_widens_as_lame_says(here: Path, element: str, most: float) -> None:
    """Timoshenko and Goodier, section 28: plane strain, inner pressure 1, radii 1 and 2."""
    found = solved(
        "tube.toml", "--deck", "static", "--material", "E=1000,nu=0.3", *PLANE_STRAIN,
        "--pressure", "w=0:1", "--element", element, "--cells", "12x1x8",
    )  # fmt: skip
    radius = np.hypot(found.points[:, 0], found.points[:, 1])
    moved = found.steps[-1].fields["DISP"]
    inside = np.abs(radius - 1) < 1e-5
    assert inside.sum() > 10
    outwards = (moved[inside, :2] * found.points[inside, :2]).sum(axis=1)
    assert outwards == pytest.approx(1.3 / 3000 * (0.4 + 4), rel=most)


@needs_ccx
@pytest.mark.interop
def test_a_tube_has_the_temperature_of_a_logarithm(here: Path) -> None:
    """Carslaw and Jaeger, section 7.2; and where the nodes are in the part."""
    found = solved(
        "tube.toml", "--deck", "heat", "--material", "k=50", "--temperature", "w=0:100",
        "--temperature", "w=1:0", "--cells", "8x1x8",
    )  # fmt: skip
    part = pc.compile_equation(pc.read_template("tube.toml").bind())
    places = part.read_results("job.frd").parameters
    radius = np.hypot(found.points[:, 0], found.points[:, 1])
    assert 1 + places[:, 2] == pytest.approx(radius, abs=1e-5)
    warm = found.steps[-1].fields["NDTEMP"][:, 0]
    assert warm == pytest.approx(100 * np.log(2 / radius) / math.log(2), abs=2e-3)


@needs_ccx
@pytest.mark.interop
def test_a_bar_sounds_as_long_as_it_is(here: Path) -> None:
    """Held at one end and sideways: sound of c = sqrt(E/rho), frequencies (2n - 1) c/(4 L)."""
    sideways = [f"{side}:{axis}" for side, axis in zip(("v=0", "v=1", "w=0", "w=1"), "yyzz",
                                                       strict=True)]  # fmt: skip
    found = solved(
        "bar.toml", "--deck", "frequency", "--material", "E=210e3,nu=0,rho=7.85e-9", "--modes", "3",
        "--fix", "u=0", *(x for side in sideways for x in ("--fix", side)), "--cells", "28x1x1",
    )  # fmt: skip
    first = math.sqrt(210e3 / 7.85e-9) / (4 * 7)
    assert [step.value for step in found.steps] == pytest.approx(
        [first, 3 * first, 5 * first], rel=1e-4
    )


@pytest.mark.interop
@needs_ccx
def test_a_temperature_that_is_a_field_expands_a_held_block(here: Path) -> None:
    """Held at all sides but the upper: du/dz = α T (1 + ν)/(1 - ν), T = 100 z²."""
    sides = [("u=0", "x"), ("u=1", "x"), ("v=0", "y"), ("v=1", "y"), ("w=0", "z")]
    found = solved(
        graded_bar(), "--cells", "7x1x8", "--deck", "static", "--warm", "heat",
        "--material", "E=210e3,nu=0.3,alpha=1e-5",
        *(text for side, axis in sides for text in ("--fix", f"{side}:{axis}")),
    )  # fmt: skip
    z = found.points[:, 2]
    exact = 1e-5 * 100 * z**3 / 3 * 1.3 / 0.7
    np.testing.assert_allclose(found.steps[0].fields["DISP"][:, 2], exact, atol=2e-6 * exact.max())


@pytest.mark.interop
@needs_ccx
def test_a_graded_bar_is_as_long_as_its_stiffness_says(here: Path) -> None:
    """E = E₀ (1 + x/L), pulled by p: u = p L/E₀ ln(1 + x/L)."""
    found = solved(
        graded_bar(), "--cells", "28x1x1", "--deck", "static", "--bins", "28",
        "--material", "E=stiff,nu=0", "--fix", "u=0", "--pressure", "u=1:-1",
    )  # fmt: skip
    x, moved = found.points[:, 0], found.steps[0].fields["DISP"][:, 0]
    # between the ends of its cells, each of one stiffness, a bar is bent by h²/8 of u''
    ends = np.abs(x * 4 - np.round(x * 4)) < 1e-4
    assert ends.sum() == 29 * 8
    exact = 7 / 1000 * np.log(1 + x[ends] / 7)
    np.testing.assert_allclose(moved[ends], exact, atol=1e-4 * exact.max())


@pytest.mark.interop
@needs_ccx
def test_a_hollow_ball_widens_as_lame_says(here: Path) -> None:
    """An octant under inner pressure, its pole in wedges; Timoshenko & Goodier, §136."""
    Path("ball.toml").write_text(
        'title = "Octant of a hollow ball"\n[domain]\nu = [0, "1/4"]\nv = [0, "1/4"]\n[solid]\n'
        'x = "(1 + w)*cos(2*pi*u)*cos(2*pi*v)"\ny = "(1 + w)*sin(2*pi*u)*cos(2*pi*v)"\n'
        'z = "(1 + w)*sin(2*pi*v)"\n'
    )
    found = solved(
        "ball.toml", "--cells", "6x6x6", "--deck", "static", "--material", "E=1000,nu=0.3",
        "--fix", "u=0:y", "--fix", "u=0.25:x", "--fix", "v=0:z", "--pressure", "w=0:1",
        "--element", "C3D20",
    )  # fmt: skip
    r = np.linalg.norm(found.points, axis=1)
    moved = (found.steps[0].fields["DISP"] * found.points).sum(axis=1) / r
    exact = 1 / (1000 * 7) * (0.4 * r + 1.3 * 8 / (2 * r**2))
    assert len(r) > 500
    np.testing.assert_allclose(moved, exact, atol=3e-4 * exact.max())


@pytest.mark.interop
@needs_ccx
def test_a_ring_has_the_frequencies_of_a_thin_ring(here: Path) -> None:
    """A quarter, symmetric in three planes: n(n² - 1)/√(n² + 1) √(EI/(ρA))/(2πR²), n = 2 and 4."""
    Path("ring.toml").write_text(
        'title = "Quarter of a ring"\n[domain]\nu = [0, "1/4"]\n[solid]\n'
        'x = "(9.9 + 0.2*w)*cos(2*pi*u)"\ny = "(9.9 + 0.2*w)*sin(2*pi*u)"\nz = "v/10"\n'
    )
    found = solved(
        "ring.toml", "--cells", "24x1x1", "--deck", "frequency", "--modes", "2",
        "--material", "E=210e3,nu=0.3,rho=7.85e-9",
        "--fix", "u=0:y", "--fix", "u=0.25:x", "--fix", "v=0:z",
    )  # fmt: skip
    slender = math.sqrt(210e3 * 0.2**2 / 12 / 7.85e-9) / (2 * math.pi * 10**2)
    exact = [n * (n**2 - 1) / math.sqrt(n**2 + 1) * slender for n in (2, 4)]
    assert [step.value for step in found.steps] == pytest.approx(exact, rel=1e-3)


@pytest.mark.interop
@needs_ccx
def test_axes_that_turn_with_the_solid_lead_heat_through_the_wall(here: Path) -> None:
    """Axis 1 across the wall of a tube, element by element: T of a logarithm, in second order."""
    errors = []
    for cells in ("16x1x4", "32x1x4"):
        found = solved(
            "tube.toml", "--cells", cells, "--deck", "heat", "--material", "k1=5,k2=1,k3=7",
            "--orient", "w,u", "--temperature", "w=0:100", "--temperature", "w=1:0",
        )  # fmt: skip
        radius = np.hypot(found.points[:, 0], found.points[:, 1])
        warm = found.steps[-1].fields["NDTEMP"][:, 0]
        errors.append(np.abs(warm - 100 * np.log(2 / radius) / math.log(2)).max())
        inside = np.abs(radius - 1) < 1e-5
        flow = found.steps[-1].fields["RFL"][inside, 0].sum()
    assert errors[1] < 0.2
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.05)
    # a quarter, half as long as the inner radius
    assert flow == pytest.approx(5 * 100 * math.pi / 4 / math.log(2), rel=1e-3)


@pytest.mark.interop
@needs_ccx
@pytest.mark.parametrize(("axes", "modulus"), [("u,v", "E1"), ("v,u", "E2"), ("v,way", "E2")])
def test_an_orthotropic_bar_is_as_stiff_as_along_its_axis(
    here: Path, axes: str, modulus: str
) -> None:
    constants = {
        "E1": 1000, "E2": 400, "E3": 300, "nu12": 0.2, "nu13": 0.1, "nu23": 0.15,
        "G12": 200, "G13": 150, "G23": 100,
    }  # fmt: skip
    found = solved(
        graded_bar(), "--cells", "2x1x1", "--deck", "static", "--orient", axes, "--material",
        ",".join(f"{name}={value}" for name, value in constants.items()),
        "--fix", "u=0:x", "--fix", "v=0:y", "--fix", "w=0:z", "--pressure", "u=1:-2",
    )  # fmt: skip
    x, moved = found.points[:, 0], found.steps[0].fields["DISP"][:, 0]
    np.testing.assert_allclose(moved, 2 * x / constants[modulus], rtol=1e-5, atol=1e-9)


ELBOW = """
title = "Half of a pipe bend"
[parameters]
R = 3
t = 0.05
[domain]
u = [0, "1/4"]
v = [0, "1/2"]
[let]
s = "1 + t*(w - 1/2)"
[solid]
x = "(R + s*cos(2*pi*v))*cos(2*pi*u)"
y = "(R + s*cos(2*pi*v))*sin(2*pi*u)"
z = "s*sin(2*pi*v)"
[fields]
turn = "-1e-3*(y - R)"
"""


@pytest.mark.interop
@needs_ccx
@pytest.mark.parametrize(("element", "least", "most"), [("C3D20R", 0.95, 1.05), ("C3D8", 0, 0.4)])
def test_a_pipe_bend_is_as_flexible_as_its_characteristic_says(
    here: Path, element: str, least: float, most: float
) -> None:
    """1.65/h times a straight pipe's, h = t R/r² = 0.15; full elements of order 1 are locked.

    ASME B31.3, appendix D. Both ends are planes, one turned by 1e-3.
    """
    Path("elbow.toml").write_text(ELBOW)
    found = solved(
        "elbow.toml", "--cells", "6x16x1", "--deck", "static", "--element", element,
        "--material", "E=210e3,nu=0.3", "--fix", "u=0:y", "--fix", "v=0:z", "--fix", "v=0.5:z",
        "--move", "u=0.25:x:turn",
    )  # fmt: skip
    force = found.steps[0].fields["FORC"]
    end = np.abs(found.points[:, 0]) < 1e-5
    moment = 2 * (force[end, 0] * (found.points[end, 1] - 3)).sum()
    inertia = math.pi / 4 * (1.025**4 - 0.975**4)
    factor = 210e3 * inertia * 1e-3 / (abs(moment) * 3 * math.pi / 2)
    assert least < factor * 0.15 / 1.65 < most


@pytest.mark.interop
@needs_ccx
def test_a_coil_spring_has_the_rate_of_its_wire(here: Path) -> None:
    """G d⁴/(8 D³ n), of the shipped spring with four turns, clamped at both ends."""
    found = solved(
        "spring", "-s", "turns=4", "--cells", "96x8x2", "--deck", "static", "--fix", "u=0",
        "--fix", "u=1:xy", "--move", "u=1:z:1", "--material", "E=210e3,nu=0.3",
    )  # fmt: skip
    moved, force = (found.steps[0].fields[name] for name in ("DISP", "FORC"))
    end = moved[:, 2] > 1 - 1e-5
    assert end.sum() > 40
    rate = 210e3 / 2.6 * 2**4 / (8 * 20**3 * 4)
    assert force[end, 2].sum() == pytest.approx(rate, rel=5e-3)
