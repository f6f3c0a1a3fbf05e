"""Files of strangers to templates: what is read of them, and what is refused, with its line."""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from shipped import checked_of

import pc2cad as pc
from pc2cad.channels.depths import LayersTooDeepError, find_depth
from pc2cad.checked import check_map
from pc2cad.cli.main import main
from pc2cad.errors import InputError
from pc2cad.expression.scalar import evaluate
from pc2cad.expression.tree import walk
from pc2cad.expression.wave_values import jet
from pc2cad.templates.file import parse_template
from pc2cad.templates.importers.airfoil import import_airfoil, read_airfoil
from pc2cad.templates.importers.boundary import line_of_sight, volume_and_area
from pc2cad.templates.importers.kinds import imported, layers_of
from pc2cad.templates.importers.lines import FileNotReadableError
from pc2cad.templates.importers.net import import_points
from pc2cad.templates.importers.vmec import import_vmec, read_surface
from pc2cad.templates.shipped import template_paths

DATA = Path(__file__).parent / "data"
#: periods, volume and area of all periods, waves of R and Z
BOUNDARIES = {
    "circular_tokamak": (1, 473.741011252289, 473.7410112523),
    "ITERModel": (1, 473.741011252289, 473.7410112523),
    "rotating_ellipse": (3, 197.392088021787, 320.0080042218),
    "NuhrenbergZille_1988_QHS": (6, 188.552389137478, 522.8230881593),
    "li383_low_res": (3, 2.978717214537, 24.5194974602),
    "cfqs_2b40": (2, 1.036412205699, 11.8779789920),
    "LandremanSenguptaPlunk_section5p3": (3, 0.199228326303, 4.6464335150),
    "LandremanPaul2021_QA_lowres": (2, 0.564712363025, 8.7225153602),
    "W7-X_standard_configuration": (5, 28.598786068666, 136.6621925973),
}
TOKAMAK = """\
&INDATA
  LFREEB = F   MGRID_FILE = 'NONE /'   ! a comment = 1 /
  NFP = 2
  AM = 11*0.0, 1
  RBC(0,0) = 6.0  ZBS(0,0) = 0.0
  rbc( 0 , 1 ) = 2.0D+00,
  ZBS(0,1) = 2.5
/
RBC(0,2) = 9
"""


@pytest.fixture
def written(tmp_path: Path) -> Callable[[str], Path]:
    def write(text: str) -> Path:
        path = tmp_path / "input.text"
        path.write_bytes(text.encode("latin-1"))
        return path

    return write


@pytest.mark.parametrize("name", BOUNDARIES)
def test_plasmas_have_their_volumes_and_areas(name: str) -> None:
    periods, volume, area = BOUNDARIES[name]
    path = DATA / f"vmec.{name}"
    surface = read_surface(path)
    assert surface.periods == periods
    assert volume_and_area(surface) == pytest.approx((volume, area), rel=1e-9)
    checked = check_map(parse_template(import_vmec(path), name).bind())
    assert checked.orientation.verdict.value == "proved"
    assert checked.mass.volume * periods == pytest.approx(volume, rel=1e-9)
    # of the boundary: the widest face; the others are the ends of a period
    assert max(checked.mass.face_areas) * periods == pytest.approx(area, rel=1e-9)
    series = [n for n in walk(checked.equation.coordinates) if n.op == "fourier"]
    assert len(series) <= 4


def steiner(name: str, depth: float, count: int = 384) -> float:
    """Return the volume of a wall of all periods, ∫∫ (R + t n_R)(1 + κt) dt ds dφ, 0 < t < d."""
    surface = read_surface(DATA / f"vmec.{name}")
    theta = 2 * np.pi * np.arange(count)[:, None] / count
    phi = 2 * np.pi * np.arange(count)[None, :] / count / surface.periods
    (r, dr, ddr), (_, dz, ddz) = (
        [value for _, value in jet(waves, theta, phi, ((0, 0), (1, 0), (2, 0)))]
        for waves in surface.series
    )
    size = np.hypot(dr, dz)
    bend, outward = (dr * ddz - dz * ddr) / size**3, dz / size
    strip = r * depth + (outward + r * bend) * depth**2 / 2 + outward * bend * depth**3 / 3
    return float((strip * size).mean()) * 4 * np.pi**2


@pytest.mark.slow
def test_layers_in_the_planes_of_the_sections() -> None:
    layers = {"wall": 0.1, "blanket": 0.2, "vessel 2": 0.05}
    text = import_vmec(DATA / "vmec.NuhrenbergZille_1988_QHS", layers)
    checked = check_map(parse_template(text, "wall").bind())
    volumes = [volume for volume, _ in checked.mass.layers]
    depths = [0.1, 0.3, 0.35]
    below = [0.0, *(steiner("NuhrenbergZille_1988_QHS", d) / 6 for d in depths)]
    assert volumes == pytest.approx(np.diff(below), rel=1e-9)
    assert checked.equation.layers == ("wall", "blanket", "vessel 2")


@pytest.mark.parametrize("measured", ["plane", pytest.param("normal", marks=pytest.mark.slow)])
def test_all_periods_are_closed_and_one_wall_is_no_layers(measured: str) -> None:
    path = DATA / "vmec.rotating_ellipse"
    text = import_vmec(path, {"wall": 0.1}, measured=measured, periods=3)
    checked = check_map(parse_template(text, "wall").bind())
    assert len(checked.mass.face_areas) == 2
    assert not checked.equation.layers
    if measured == "plane":
        assert checked.mass.volume == pytest.approx(steiner("rotating_ellipse", 0.1), rel=1e-9)
    else:
        # the mean of inner and outer area, but for the second order of the depth
        mean = sum(checked.mass.face_areas) / 2
        assert checked.mass.volume == pytest.approx(0.1 * mean, rel=2e-3)
    assert min(checked.mass.face_areas) == pytest.approx(320.0080042218, rel=1e-9)


@pytest.mark.slow
def test_all_waves_of_w7x_are_proved_within_the_tolerance() -> None:
    text = import_vmec(DATA / "vmec.W7-X_standard_configuration", {"wall": 0.1})
    report = pc.compile_equation(parse_template(text, "wall").bind(), tolerance=1e-4).report
    assert report.evidence == "bounded"
    assert report.deviation <= 1e-4
    exact = steiner("W7-X_standard_configuration", 0.1) / 5
    assert report.equation.volume == pytest.approx(exact, rel=1e-9)
    assert report.solid.volume == pytest.approx(exact, rel=1e-5)


def test_a_thickness_may_go_with_both_angles() -> None:
    layers = layers_of("wall=0.1, blanket=thick(u, 3*v)")
    text = import_vmec(DATA / "vmec.rotating_ellipse", layers) + (
        '[tables.thick]\nat = [[0, "pi", "2*pi"], [0, "pi", "2*pi"]]\nperiodic = [true, true]\n'
        "values = [[0.4, 0.3, 0.4], [0.2, 0.3, 0.2], [0.4, 0.3, 0.4]]\n"
    )
    checked = check_map(parse_template(text, "wall").bind())
    even = import_vmec(DATA / "vmec.rotating_ellipse", layers_of("wall=0.1,blanket=0.3"))
    other = check_map(parse_template(even, "wall").bind())
    first, second = ([v for v, _ in c.mass.layers] for c in (checked, other))
    assert first[0] == pytest.approx(second[0], rel=1e-12)
    assert abs(first[1] - second[1]) > 1e-3


def test_too_deep_is_refused_with_angles_and_depth() -> None:
    text = import_vmec(DATA / "vmec.NuhrenbergZille_1988_QHS", {"wall": 0.5, "blanket": 1.5})
    with pytest.raises(
        LayersTooDeepError, match=r"u = 3\.1416, v = 0 at a depth of 1\.141 m, .* 2 m"
    ):
        check_map(parse_template(text, "wall").bind())


@pytest.mark.slow
def test_how_deep_layers_can_go() -> None:
    """In the planes of the sections, as deep as the least radius of a hollow bend."""
    surface = read_surface(DATA / "vmec.NuhrenbergZille_1988_QHS")
    theta, phi = np.linspace(3.1, 3.2, 401)[:, None], np.linspace(0, 0.02, 41)[None, :]
    (dr, ddr), (dz, ddz) = (
        [value for _, value in jet(waves, theta, phi, ((1, 0), (2, 0)))] for waves in surface.series
    )
    radius = np.hypot(dr, dz) ** 3 / (dz * ddr - dr * ddz)
    for layers in ({"wall": 0.1, "blanket": 0.3}, {"wall": 0.2, "gap": 0.05, "blanket": 0.1}):
        text = import_vmec(DATA / "vmec.NuhrenbergZille_1988_QHS", layers)
        (limit,) = find_depth(parse_template(text, "wall").bind())
        assert limit.holds
        assert limit.value == pytest.approx(sum(layers.values()))
        assert limit.breaks_at == pytest.approx(radius.min(), rel=1e-6)
    (shipped,) = checked_of("layered_pipe").limits[-1:]
    # the bore is 1, and the tightest bend has a radius of 4
    assert (shipped.name, shipped.breaks_at) == ("depth", pytest.approx(3, rel=1e-6))


def test_one_layer_and_what_knows_no_depth_have_no_limit_of_it() -> None:
    equation = parse_template(
        import_vmec(DATA / "vmec.rotating_ellipse", {"wall": 0.1}), "w"
    ).bind()
    assert find_depth(equation) == ()
    assert find_depth(pc.read_template(template_paths()["spring"]).bind()) == ()


def test_what_is_read_of_a_namelist(written: Callable[[str], Path]) -> None:
    surface = read_surface(written(TOKAMAK))
    assert surface.periods == 2
    assert surface.waves["rbc"] == [(0, 0, 6), (1, 0, 2)]
    assert surface.waves["zbs"] == [(1, 0, 2.5)]
    again = read_surface(
        written(TOKAMAK.replace("\n", "\r\n").replace("RBC(0,0) = 6.0", "RBC(-1,0)=0, 6.0"))
    )
    assert again.waves["rbc"] == [(0, 0, 6), (1, 0, 2)]


def test_sines_of_r_count_only_where_the_file_says_so(written: Callable[[str], Path]) -> None:
    text = TOKAMAK.replace("NFP = 2", "NFP = 2\nRBS(0,1) = 0.1")
    assert read_surface(written(text)).waves["rbs"] == []
    asymmetric = text.replace("NFP = 2", "NFP = 2\nLASYM = .TRUE.")
    assert read_surface(written(asymmetric)).waves["rbs"] == [(1, 0, pytest.approx(0.1))]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("&INDATA", "&OTHER"), "no namelist &INDATA"),
        (("NFP = 2", "NFP = 2.5"), "line 3: NFP is a whole number"),
        (("NFP = 2", "NFP = 0"), "line 3: NFP is a whole number"),
        (("NFP = 2", "LASYM = maybe"), "line 3: LASYM is T or F"),
        (("= 6.0", "= six"), "line 5: a number is expected, and 'six' was found"),
        (("= 6.0", "= nan"), "line 5: a number is expected"),
        (("= 6.0", "="), r"line 5: RBC\(0,0\) has no value"),
        (("= 6.0", "= 6e99"), "line 5: 6e99 is outside the range"),
        (("RBC(0,0)", "RBC(0:5,0)"), "line 5: .*two whole numbers"),
        (("RBC(0,0)", "RBC(999,0)"), "line 5: .*beyond 200"),
        (("= 6.0", "= 999999*1"), "line 5: 999999 values are more"),
        (("RBC(0,0) = 6.0", "\nRBC(0,0) = 1.0e"), "line 6: a number is expected"),
        (("rbc( 0 , 1 )", "rbc( 0 , 1 ] ="), r"line 5: a number is expected"),
        (("ZBS", "ZZZ"), "no boundary"),
        (("comment", "\0"), "line 2: a zero byte"),
        (("comment", "x" * 5000), "line 2: the line is longer"),
        (("comment", "\n" * 30_000), "more than 20000 lines"),
        (("comment", "\n".join(["!" * 3000] * 400)), "larger than 1 MB"),
    ],
)
def test_hostile_files_are_refused_with_the_line(
    written: Callable[[str], Path], change: tuple[str, str], message: str
) -> None:
    assert change[0] in TOKAMAK
    with pytest.raises(InputError, match=message):
        import_vmec(written(TOKAMAK.replace(*change)))


def test_sections_that_are_flat_or_meet_the_axis(written: Callable[[str], Path]) -> None:
    with pytest.raises(InputError, match="no surface"):
        import_vmec(written(TOKAMAK.replace("6.0", "1.0")))
    with pytest.raises(InputError, match="no surface"):
        import_vmec(written(TOKAMAK.replace("2.5", "0.0").replace("ZBS(0,0)", "ZBS(1,0)")))


def test_a_section_that_nothing_sees_whole(written: Callable[[str], Path]) -> None:
    """A horseshoe has no point from which all of it is seen."""
    horseshoe = written(TOKAMAK.replace("ZBS(0,1) = 2.5", "ZBS(0,1) = 1 ZBS(0,2) = 2.2"))
    with pytest.raises(InputError, match="give layers"):
        line_of_sight(read_surface(horseshoe))


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"measured": "up"}, "plane or normal"),
        ({"periods": 0}, "periods are 1 to 2"),
        ({"periods": 3}, "periods are 1 to 2"),
        ({"layers": {"wall": -1.0}}, "a length is above 0"),
        ({"layers": {"wall": float("nan")}}, "a length is above 0"),
        ({"layers": {'a"\n[solid]': 1.0}}, "the name of a layer is"),
    ],
)
def test_options_are_checked(
    written: Callable[[str], Path], options: dict[str, object], message: str
) -> None:
    with pytest.raises(InputError, match=message):
        import_vmec(written(TOKAMAK), **options)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("wall", "name=thickness"),
        ("wall=", "name=thickness"),
        ("a=1,a=2", "two layers"),
        (",".join(f"l{i}=1" for i in range(100)), "more than 64"),
    ],
)
def test_lists_of_layers(text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        layers_of(text)


def test_a_thickness_is_an_expression_of_the_template(written: Callable[[str], Path]) -> None:
    """Texts go into the template as texts: nothing of them becomes another key."""
    text = import_vmec(written(TOKAMAK), {"wall": '1"\nw = [0, 1]', "b": 0.1})
    with pytest.raises(InputError, match=r"\[layers\] wall: column 2"):
        parse_template(text, "x")


# -- airfoils and nets of points -------------------------------------------------------------------


def naca(count: int = 12, thick: float = 0.12) -> tuple[np.ndarray, np.ndarray]:
    """Return one side of a symmetric section of four digits, from the leading edge."""
    x = np.round((1 - np.cos(np.linspace(0, np.pi, count))) / 2, 6)
    c = (-0.126, -0.3516, 0.2843, -0.1036)
    y = 5 * thick * (0.2969 * np.sqrt(x) + sum(c[k] * x ** (k + 1) for k in range(4)))
    return x, np.round(y, 6)


def selig() -> str:
    x, y = naca()
    rows = [*zip(x[::-1], y[::-1], strict=True), *zip(x[1:], -y[1:], strict=True)]
    return "\n".join(["NACA 0012", *(f"  {a:.6f} {b:.6f}" for a, b in rows)]) + "\n"


def lednicer() -> str:
    x, y = naca()
    sides = ["\n".join(f" {a:.6f}  {b:.6f}" for a, b in zip(x, side, strict=True))
             for side in (y, -y)]  # fmt: skip
    return "\n\n".join(["NACA 0012\n  12.   12.", *sides])


def test_both_orders_of_airfoils_are_one_section(written: Callable[[str], Path]) -> None:
    first = read_airfoil(written(selig()))
    assert len(first) == 23
    assert read_airfoil(written(lednicer())) == first
    assert read_airfoil(written(selig().replace("NACA 0012\n", ""))) == first


def test_a_wing_has_the_area_of_the_closed_spline(written: Callable[[str], Path]) -> None:
    path = written(selig())
    points = np.array(read_airfoil(path), dtype=float)
    at = np.concatenate(([0], np.hypot(*np.diff(points, axis=0).T).cumsum()))
    spline = CubicSpline(at / at[-1], points, bc_type="natural")
    nodes, weights = np.polynomial.legendre.leggauss(6)
    middle, half = (at[1:] + at[:-1]) / at[-1] / 2, np.diff(at) / at[-1] / 2
    t = (middle[:, None] + half[:, None] * nodes).ravel()
    (x, _), (_, dy) = spline(t).T, spline(t, 1).T
    area = abs(float((x * dy) @ (half[:, None] * weights).ravel()))
    wing = parse_template(import_airfoil(path, span=3), "wing").bind({"chord": 2, "span": 7})
    assert check_map(wing).mass.volume == pytest.approx(area * 4 * 7, rel=1e-9)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("nothing", "at least 6 points"),
        (selig().replace("\n", "\n1 2 3\n", 1), "line 2: a point is two numbers"),
        (selig() + "0.5 half\n", "line 25: a number is expected, and 'half'"),
        (selig() + "1.000000 0.000000\n", "line 25: the point is the one before it"),
        (lednicer().replace("12.   12.", "12.   13."), "line 2: 12 and 13 points are announced"),
        (lednicer().replace("12.   12.", "12.5   11.5"), "line 2: counts .* whole"),
        ("t\n" + "\n".join(f"0.{i:06} 0.1" for i in range(3000)), "line 2002: .* at most 2000"),
    ],
)
def test_airfoils_that_are_none(written: Callable[[str], Path], text: str, message: str) -> None:
    with pytest.raises(FileNotReadableError, match=message):
        read_airfoil(written(text))


def test_the_span_of_a_wing_is_a_length(written: Callable[[str], Path]) -> None:
    for wrong in ("long", "-1", "0", "1e9"):
        with pytest.raises(FileNotReadableError):
            import_airfoil(written(selig()), span=wrong)


def net(first: int = 1, header: str = "i,j,k,x,y,z\n") -> str:
    places = product(range(3), range(3), range(2))
    rows = (f"{i + first}, {j + first}, {k + first}, {2 * i}, {j + 0.1 * i * k}, {3 * k}"
            for i, j, k in places)  # fmt: skip
    return header + "\n".join(rows) + "\n"


@pytest.mark.parametrize("text", [net(), net(0, ""), net().replace(",", ";")])
def test_a_solid_through_a_net_of_points(written: Callable[[str], Path], text: str) -> None:
    equation = parse_template(import_points(written(text)), "net").bind()
    at = {"u": 0.5, "v": 1.0, "w": 1.0}
    assert [evaluate(c, at) for c in equation.coordinates] == pytest.approx([2, 2.1, 3], abs=1e-12)
    assert check_map(equation).mass.volume == pytest.approx(4 * 2 * 3, rel=1e-9)


def test_a_plate_on_a_surface_through_points(written: Callable[[str], Path]) -> None:
    rows = "\n".join(f"{i},{j},{i},{j},0" for i in range(3) for j in range(3))
    plate = parse_template(import_points(written(rows)), "net").bind({"thickness": 0.25})
    assert check_map(plate).mass.volume == pytest.approx(1, rel=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (("1, 1, 1, 0, 0.0, 0", "1, 1, 1, 0, 0.0"), "line 2: a line is i, j, x, y, z|columns"),
        (("3, 3, 2, 4", "3, 3, 2, four"), "line 19: a number is expected, and 'four'"),
        (("3, 3, 2, 4", "3, 3, 1, 4"), r"line 19: the point \(3, 3, 1\) is given in line 18 too"),
        (("3, 3, 2, 4", "3, 3.5, 2, 4"), "line 19: an index is a whole number"),
        (("3, 3, 2, 4", "3, 3, 20000, 4"), "line 19: an index is a whole number"),
        (("3, 3, 2, 4", "# 3, 3, 2, 4"), r"the net has no point \(3, 3, 2\)"),
    ],
)
def test_nets_with_holes_and_lines_that_are_none(
    written: Callable[[str], Path], change: tuple[str, str], message: str
) -> None:
    assert change[0] in net()
    with pytest.raises(FileNotReadableError, match=message):
        import_points(written(net().replace(*change)))


def test_a_matrix_of_thicknesses(written: Callable[[str], Path]) -> None:
    """A table over both angles: here one that goes with the first, as a spline of SciPy."""
    turns, deep = np.linspace(0, 2 * np.pi, 7), np.array([0.2, 0.3, 0.25, 0.4, 0.3, 0.2, 0.2])
    at = ", ".join(f'"{k}*pi/3"' for k in range(7))
    rows = ", ".join(f"[{d}, {d}, {d}, {d}]" for d in deep)
    table = f"""
[tables.thick]
at = [[{at}], [0, "2*pi/3", "4*pi/3", "2*pi"]]
values = [{rows}]
periodic = [true, true]
"""
    path = DATA / "vmec.rotating_ellipse"
    layers = {"wall": 0.1, "blanket": "thick(u, 3*v)"}
    checked = check_map(parse_template(import_vmec(path, layers) + table, "wall").bind())
    spline = CubicSpline(turns, deep, bc_type="periodic")
    nodes, weights = np.polynomial.legendre.leggauss(24)
    theta = (turns[:-1, None] + (nodes + 1) * np.pi / 6).ravel()
    phi = 2 * np.pi * np.arange(128)[None, :] / 128 / 3
    (r, dr, ddr), (_, dz, ddz) = (
        [v for _, v in jet(waves, theta[:, None], phi, ((0, 0), (1, 0), (2, 0)))]
        for waves in read_surface(path).series
    )
    size = np.hypot(dr, dz)
    bend, outward = (dr * ddz - dz * ddr) / size**3, dz / size
    low, high = 0.1, 0.1 + spline(theta)[:, None]
    strip = sum(c * (high**k - low**k) / k
                for k, c in ((1, r), (2, outward + r * bend), (3, outward * bend)))  # fmt: skip
    around = np.tile(weights * np.pi / 6, 6)
    volume = float(around @ (strip * size).mean(axis=1)) * 2 * np.pi / 3
    assert checked.mass.layers[1][0] == pytest.approx(volume, rel=1e-9)


@pytest.mark.parametrize("source", ["vmec", "vmec:", "step:a.stp", ":x", "", "VMEC:x"])
def test_kinds_that_are_none(source: str) -> None:
    with pytest.raises(InputError, match="--from is vmec:FILE"):
        imported(source, {})


def test_new_from_the_command_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    boundary = str(DATA / "vmec.circular_tokamak")
    assert main(["new", "w.toml", "--from", f"vmec:{boundary}", "--layers", "a=0.1,b=0.2"]) == 0
    volumes = [v for v, _ in check_map(pc.read_template("w.toml").bind()).mass.layers]
    rings = 2 * np.pi**2 * 6 * np.diff(np.square([2, 2.1, 2.3]))
    assert volumes == pytest.approx(rings, rel=1e-12)
    assert main(["new", "c.toml", "--from", "template:ball"]) == 0
    assert Path("c.toml").read_text() == template_paths()["ball"].read_text()
    capsys.readouterr()
    assert main(["new", "d.toml", "--from", "template:ball", "--layers", "a=1"]) == 2
    assert "no meaning for --from template" in capsys.readouterr().err
    assert main(["new", "d.toml", "--periods", "2"]) == 2
    assert "needs --from" in capsys.readouterr().err
    assert main(["new", "d.toml", "--from", "vmec:none.here"]) == 2
    assert "cannot be read" in capsys.readouterr().err
    assert not Path("d.toml").exists()


def test_a_folder_is_no_file(tmp_path: Path) -> None:
    with pytest.raises(FileNotReadableError, match="not a regular file"):
        import_vmec(tmp_path)


@pytest.mark.slow
def test_the_page_on_stellarators_from_top_to_bottom(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    page = (Path(__file__).parent.parent / "docs" / "stellarators.md").read_text()
    monkeypatch.chdir(tmp_path)
    ((name, text),) = re.findall(r"`(input\.\w+)`.*?^```fortran\n(.*?)^```", page, re.M | re.S)
    Path(name).write_text(text)
    lines = [line for block in re.findall(r"^```console\n(.*?)^```", page, re.M | re.S)
             for line in block.splitlines()]  # fmt: skip
    assert len(lines) == 8
    for line in lines:
        code = re.search(r"# exit code (\d)", line)
        arguments = shlex.split(line, comments=True)[1:]
        assert main(arguments) == int(code[1] if code else 0), line
    assert {p.name for p in tmp_path.iterdir()} >= {"wall.step", "wall.vtu"}
