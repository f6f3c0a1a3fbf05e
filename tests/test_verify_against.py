"""STEP files held against their equations: true ones, and ones with one thing wrong."""

from __future__ import annotations

import json
import math
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest
from consumers.step_edits import edit, instance, move, read_instances
from shipped import LONG, part_of

import pc2cad as pc
from pc2cad.checked import check_map, parted
from pc2cad.cli.main import main
from pc2cad.compiler import compile_checked, compile_solid
from pc2cad.export.model import ExportOptions
from pc2cad.options import DEFAULTS, CompileOptions
from pc2cad.templates.file import read_template
from pc2cad.templates.shipped import template_paths
from pc2cad.verify.against import verification, verify_file
from pc2cad.verify.defects import StepUnreadableError
from pc2cad.verify.receipt import parse_step

PATHS = template_paths()
QUICK = (
    "cone", "hollow_ball", "pyramid_cut", "bilinear_top", "simplex_cone", "elbow_pipe", "torus",
)  # fmt: skip
SINGLE = [name for name, path in PATHS.items() if "bodies" not in path.read_text()]


def write(name: str, path: Path, options: CompileOptions = DEFAULTS, schema: str = "AP242") -> str:
    # what is built as usual is shared with other tests
    usual = options == DEFAULTS
    part = part_of(name) if usual else compile_solid(read_template(PATHS[name]).bind(), options)
    part.write(path, options=ExportOptions(step_schema=schema))
    return str(path)


@pytest.fixture(scope="session")
def files(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], str]:
    folder = tmp_path_factory.mktemp("true")
    made: dict[str, str] = {}

    def text(name: str) -> str:
        if name not in made:
            made[name] = read_instances(Path(write(name, folder / f"{name}.step")))
        return made[name]

    return text


def differences(text: str, name: str) -> tuple[str, ...]:
    equation = read_template(PATHS[name]).bind()
    try:
        return verification(parse_step(text.encode()), equation).differences
    except StepUnreadableError as error:
        return (f"unreadable: {error}",)


@pytest.mark.parametrize("name", QUICK)
def test_true_files_are_verified(files: Callable[[str], str], name: str) -> None:
    assert differences(files(name), name) == ()


def test_faces_cut_in_their_middles_are_held_against_pieces_of_sides(tmp_path: Path) -> None:
    """A build cuts faces that its checker cannot tell apart, and names them after the pieces."""
    equation = read_template(PATHS["hexahedron"]).bind()
    cut = compile_checked(parted(parted(check_map(equation, faces=True), 0), 1))
    cut.write(tmp_path / "cut.step")
    found = verification(parse_step((tmp_path / "cut.step").read_bytes()), equation)
    assert found.verified, found.differences
    assert len({m.name for m in found.matches}) == len(found.matches) == 2 * 4 + 2 * 2 + 2 * 2
    text = read_instances(tmp_path / "cut.step").replace("(piece 2 of u)'", "(piece 9 of u)'", 1)
    assert not verification(parse_step(text.encode()), equation).verified


def test_a_border_beside_a_cusp_is_found(tmp_path: Path) -> None:
    """The nearest sample may be the cusp, where the tangent vanishes and no step is made."""
    u, v, w = pc.parameters()
    t = 2 * pc.pi * v
    x = 16 * pc.sin(t) ** 3
    y = 13 * pc.cos(t) - 5 * pc.cos(2 * t) - 2 * pc.cos(3 * t) - pc.cos(4 * t)
    heart = pc.compile_part([x * w, y * w, 5 * u])
    heart.write(tmp_path / "heart.step")
    found = pc.verify(tmp_path / "heart.step", heart.equation)
    assert found["verified"], found["differences"]


#: of each template one kind of file: all kinds of all templates take half an hour
KINDS = ("AP214", "cubic", "fine", "rough")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "kind"),
    [(name, "AP214" if name in LONG else KINDS[i % 4]) for i, name in enumerate(SINGLE)],
)
def test_all_templates_are_verified(name: str, kind: str, tmp_path: Path) -> None:
    size = 10.0
    options = {
        "AP214": CompileOptions(),
        "cubic": CompileOptions(profile="cubic"),
        "fine": CompileOptions(tolerance=1e-8 * size),
        "rough": CompileOptions(tolerance=1e-4 * size),
    }[kind]
    file = write(name, tmp_path / "part.step", options, "AP214" if kind == "AP214" else "AP242")
    tolerance = None if options.tolerance is None else options.tolerance
    found = verify_file(file, str(PATHS[name]), tolerance=tolerance)
    assert found["verified"], found["differences"]


def _swap_names(text: str) -> str:
    faces = list(re.finditer(r"ADVANCED_FACE\('([^']*)'", text))
    one, other = faces[0].group(1), faces[1].group(1)
    return (
        text.replace(f"ADVANCED_FACE('{one}'", "ADVANCED_FACE('?'")
        .replace(f"ADVANCED_FACE('{other}'", f"ADVANCED_FACE('{one}'")
        .replace("ADVANCED_FACE('?'", f"ADVANCED_FACE('{other}'")
    )


def _moved_pole(by: float) -> Callable[[str], str]:
    def change(text: str) -> str:
        found = instance(text, "B_SPLINE_SURFACE_WITH_KNOTS")
        net = re.findall(r"\((#[#\d,]*)\)", found.group(3))
        middle = net[len(net) // 2].split(",")
        return move(text, middle[len(middle) // 2], by, 2)

    return change


def _moved_knot(text: str) -> str:
    """Move the first knot within the first spline surface by a thousandth."""
    found = instance(text, "B_SPLINE_SURFACE_WITH_KNOTS")
    knot = re.findall(r"\(0\.,([\d.E-]+),", found.group(3))[0]
    return edit(text, found, knot, repr(float(knot) * 1.001))


def _first(pattern: str, new: str) -> Callable[[str], str]:
    return lambda text: re.sub(pattern, new, text, count=1)


#: what is done, to the file of which template
TAMPERINGS: dict[str, tuple[str, Callable[[str], str]]] = {
    "names swapped on planes": ("pyramid_cut", _swap_names),
    "angle of the cone": ("cone", lambda t: re.sub(
        r"(CONICAL_SURFACE\('',#\d+,[\d.E+-]+,)[\d.E+-]+", r"\g<1>0.6", t)),
    "radius of the ball": ("hollow_ball", lambda t: re.sub(
        r"(SPHERICAL_SURFACE\('',#\d+,)2\.", r"\g<1>2.00001", t)),
    "radius of the void": ("hollow_ball", lambda t: re.sub(
        r"(SPHERICAL_SURFACE\('',#\d+,)1\.", r"\g<1>1.00001", t)),
    "torus": ("torus", lambda t: re.sub(
        r"(TOROIDAL_SURFACE\('',#\d+,5\.,)2\.", r"\g<1>2.00001", t)),
    "torus's own radius": ("torus", lambda t: re.sub(
        r"(TOROIDAL_SURFACE\('',#\d+,)5\.", r"\g<1>5.00001", t)),
    "knot": ("channel_sine", _moved_knot),
    "another solid": ("cone", lambda t: t.replace(",4.)", ",4.001)")),
}  # fmt: skip


@pytest.mark.parametrize(
    "kind", [pytest.param(k, marks=[pytest.mark.slow] * (k == "knot")) for k in TAMPERINGS]
)
def test_tampered_files_are_not_verified(files: Callable[[str], str], kind: str) -> None:
    name, change = TAMPERINGS[kind]
    text = files(name)
    changed = change(text)
    assert changed != text
    assert differences(changed, name) != ()


@pytest.mark.parametrize("by", [1e-2, pytest.param(1e-4, marks=pytest.mark.slow), 1e-5])
def test_a_moved_pole_is_found_with_its_face_and_distance(
    files: Callable[[str], str], by: float
) -> None:
    name = "channel_ellipse"
    found = differences(_moved_pole(by)(files(name)), name)
    assert any(re.search(r"the face 'w=[01]'.* mm from that of the side w=[01] \(u = ", sentence)
               for sentence in found), found  # fmt: skip


def test_other_values_of_the_parameters_are_another_solid(tmp_path: Path) -> None:
    file = write("cone", tmp_path / "cone.step")
    assert main(["verify", file, "cone"]) == 0
    assert main(["verify", file, "cone", "-s", "h=4.00001"]) == 6
    assert main(["verify", file, "cone_frustum"]) == 6
    assert main(["verify", file, "pipe_cross"]) == 6


def test_the_verb_says_what_it_found(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = Path(write("cone", tmp_path / "cone.step"))
    assert main(["verify", str(file), "cone"]) == 0
    assert "verified, no face further than" in capsys.readouterr().out
    file.write_text(_swap_names(read_instances(file)))
    assert main(["verify", str(file), "cone", "--json"]) == 6
    assert json.loads(capsys.readouterr().out)["differences"]
    assert main(["verify", str(file), "cone"]) == 6
    assert "it lies on" in capsys.readouterr().out


def test_no_kernel_is_loaded_to_verify(tmp_path: Path) -> None:
    file = write("cone", tmp_path / "cone.step")
    code = (
        "import sys; import pc2cad as pc;"
        "assert pc.verify(sys.argv[1], 'cone')['verified'];"
        "bad = {'OCP', 'cadquery', 'sympy', 'pc2cad.brep', 'pc2cad.representation',"
        "'pc2cad.validation', 'pc2cad.part', 'pc2cad.compiler'}; print(bad & set(sys.modules))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code, file], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "set()"


@pytest.mark.parametrize(
    ("name", "surfaces", "edges"),
    [
        ("torus_wedge", {"exact"}, {"exact"}),
        ("bilinear_top", {"exact", "bounded"}, {"exact"}),
        ("naca_wing", {"exact", "bounded"}, {"bounded"}),
        ("helical_channel", {"exact", "bounded"}, {"bounded"}),
        ("disc_cam", {"exact", "bounded"}, {"bounded"}),
        ("aspheric_lens", {"exact", "sampled"}, {"exact", "sampled"}),
    ],
)
def test_it_says_what_faces_and_edges_rest_on(
    files: Callable[[str], str], name: str, surfaces: set[str], edges: set[str]
) -> None:
    equation = read_template(PATHS[name]).bind()
    found = verification(parse_step(files(name).encode()), equation)
    assert found.verified
    assert {match.nearness.rests_on for match in found.matches} == surfaces
    assert {match.edges.rests_on for match in found.matches} == edges
    for match in found.matches:
        assert match.surface.distance <= match.reach <= found.tolerance
        assert match.border.distance <= match.border_reach <= found.tolerance
    kinds = ["exact", "bounded", "sampled"]
    assert found.evidence == max(surfaces | edges, key=kinds.index)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("solid", "area"),
    [
        ('x = "u"\ny = "10*v"\nz = "w*(1+100*u*(u-0.5)^2)"', None),
        (
            'x = "u"\ny = "v"\nz = "w*(1+0.4*(128*t^8-256*t^6+160*t^4-32*t^2+1))"\n'
            '[let]\nt = "2*u-1"',
            12.340717384169,
        ),
        ('x = "w*cos(2*pi*u)^3"\ny = "w*sin(2*pi*u)^3"\nz = "2*v"', 12 + 3 * math.pi / 4),
    ],
    ids=["steep", "waves", "cusps"],
)
def test_places_on_steep_sides_are_found(solid: str, area: float | None, tmp_path: Path) -> None:
    template, path = tmp_path / "steep.toml", tmp_path / "steep.step"
    template.write_text(f'title = "steep"\n[solid]\n{solid}\n')
    equation = read_template(template).bind()
    compile_solid(equation).write(path)
    found = verification(parse_step(path.read_bytes()), equation)
    assert found.differences == ()
    if area is not None:
        assert found.file.solids[0].area == pytest.approx(area, rel=1e-6)


@pytest.mark.slow
def test_the_border_of_a_needle_is_found(tmp_path: Path) -> None:
    """It is a ten-thousandth of the edge wide: even samples do not see it."""
    template = tmp_path / "needle.toml"
    template.write_text(
        'title = "needle"\n[solid]\nx = "u"\ny = "v"\nz = "w*(1+exp(-100000000*(u-0.3711)^2))"\n'
    )
    equation = read_template(template).bind()
    path = tmp_path / "needle.step"
    compile_solid(equation).write(path)
    assert verification(parse_step(path.read_bytes()), equation).differences == ()
