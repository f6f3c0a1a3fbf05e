"""Seams and poles are out of other bodies' way: no curve runs along or through one."""

from __future__ import annotations

from math import pi
from pathlib import Path

import numpy as np
import pytest
from OCP.BRep import BRep_Tool
from OCP.BRepClass3d import BRepClass3d_SolidClassifier
from OCP.TopExp import TopExp

import pc2cad as pc
from pc2cad.brep.booleans import NamedEdge, NamedShape, edges_between
from pc2cad.brep.seams import Seam, seams_of
from pc2cad.csg.seams import BORED, MET
from pc2cad.domain.analysis import analyse
from pc2cad.domain.cuts import halved
from pc2cad.errors import KernelError
from pc2cad.part import Part
from pc2cad.representation.turning import roundness, turned
from pc2cad.templates.bodies import Bodies
from pc2cad.templates.file import parse_template
from pc2cad.verify.against import verification
from pc2cad.verify.receipt import parse_step

ROUND = "2*w*cos(pi*(u - 1/2))*cos(2*pi*v), 2*w*cos(pi*(u - 1/2))*sin(2*pi*v)"
BALL = f"[{ROUND}, 2*w*sin(pi*(u - 1/2))]"
OVOID = f"[{ROUND}, 4*w*sin(pi*(u - 1/2))]"
BAR = "[2*w*cos(2*pi*v), 2*w*sin(2*pi*v), 10*u]"
TANK = "[(2 + w/4)*cos(2*pi*v), (2 + w/4)*sin(2*pi*v), 10*u]"
OVAL = "[3*w*cos(2*pi*v), 2*w*sin(2*pi*v), 10*u]"
#: all that lies behind the plane y = 0
BEHIND = "[20*(u - 1/2), 10*v, 30*(w - 1/2)]"
TURNED, HALVED = "a is turned to begin elsewhere: ", "a is cut in halves where it closes: "


def across(y: float, z: float, radius: float = 0.5) -> str:
    """A hole along x, from the middle on."""
    return f"[6*u, {y} + {radius}*w*cos(2*pi*v), {z} + {radius}*w*sin(2*pi*v)]"


def upright(x: float, y: float, radius: float = 0.5) -> str:
    """A hole along z."""
    return f"[{x} + {radius}*w*cos(2*pi*v), {y} + {radius}*w*sin(2*pi*v), 12*u - 6]"


def bodies_of(result: str, **bodies: str) -> Bodies:
    """Return bodies and how they are joined."""
    rows = (f'[[bodies]]\nname = "{n}"\n[bodies.solid]\nM = "{m}"' for n, m in bodies.items())
    text = "\n".join(['title = "Seams"', f'result = "{result}"', *rows])
    found = parse_template(text, "seams").bind()
    assert isinstance(found, Bodies)
    return found


def built(result: str, **bodies: str) -> Part:
    """Return a part of bodies."""
    return pc.compile_equation(bodies_of(result, **bodies))


def meeting(part: Part) -> tuple[tuple[NamedEdge, ...], tuple[Seam, ...]]:
    """Return the edges between bodies, and the seams and poles of a part's faces."""
    assert part.several is not None
    shape: NamedShape = part.several.shape  # type: ignore[attr-defined]
    edges = tuple(
        edge for edge in edges_between(shape)
        if {n.body for n in edge.names[0]}.isdisjoint(n.body for n in edge.names[1])
    )  # fmt: skip
    return edges, tuple(seams_of(shape))


def ends_of(edge: NamedEdge) -> list[np.ndarray]:
    """Return the points at both ends of an edge."""
    ends = (TopExp.FirstVertex_s(edge.edge), TopExp.LastVertex_s(edge.edge))
    return [np.array(BRep_Tool.Pnt_s(vertex).Coord()) for vertex in ends]


def check_apart(part: Part, *, rims: int) -> None:
    """No edge between bodies comes to a seam or a pole, but for so many rims round a whole face.

    Each begins and ends at the seam, in one place.
    """
    edges, seams = meeting(part)
    assert len(edges) >= 1
    found = set()
    for edge in edges:
        for seam in seams:
            fixed = np.linspace(seam.piece.low, seam.piece.high, 2001)
            line = seam.piece.jet(fixed)[0]
            inside = np.linalg.norm(edge.points[3:-3, None] - line, axis=2)
            assert inside.min() > 1e-3
            for end in ends_of(edge):
                if np.linalg.norm(end - line, axis=1).min() < 1e-3:
                    assert not seam.is_pole
                    found.add((id(seam), *np.round(end, 6).tolist()))
    assert len(found) == rims


def over_a_disc(x: float, y: float, radius: float, scale: float) -> float:
    """Return what a hole along z takes of the ball of radius 2, times a scale along z."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    r, turn = radius / 2 * (nodes + 1), 2 * pi * np.arange(400) / 400
    p, q = x + r[:, None] * np.cos(turn), y + r[:, None] * np.sin(turn)
    high = 2 * scale * np.sqrt(np.maximum(4 - p**2 - q**2, 0)).mean(axis=1)
    return float(radius / 2 * (weights * r) @ high) * 2 * pi


def exit_of(half: float, radius: float) -> float:
    """Return what a hole along x takes of a bar of a radius along z, from its middle on."""
    nodes, weights = np.polynomial.legendre.leggauss(80)
    y = radius * np.sin(pi / 2 * nodes)
    return float(
        pi / 2 * weights @ (np.sqrt(half**2 - y**2) * 2 * radius**2 * np.cos(pi / 2 * nodes) ** 2)
    )


@pytest.mark.parametrize("y", [0.0, 0.45, 0.499999])
def test_a_hole_through_or_beside_the_seam_of_a_bar(y: float) -> None:
    part = built("cut(a, b)", a=BAR, b=across(y, 5))
    assert part.report.seams == (TURNED + MET,)
    assert part.report.warnings == ()
    assert [face.name for face in part.report.faces].count("a:v=1") <= 1
    check_apart(part, rims=1)
    if not y:
        assert part.volume == pytest.approx(40 * pi - exit_of(2, 0.5), rel=1e-9)


def test_a_hole_through_the_seam_of_a_tank() -> None:
    part = built("cut(a, b)", a=TANK, b=across(0, 5))
    assert part.report.seams == (TURNED + MET,)
    assert part.report.warnings == ()
    wall = 10 * pi * (2.25**2 - 2**2)
    assert part.volume == pytest.approx(wall - exit_of(2.25, 0.5) + exit_of(2, 0.5), rel=1e-9)
    check_apart(part, rims=2)


def test_what_no_turn_carries_onto_itself_is_halved() -> None:
    part = built("cut(a, b)", a=OVAL, b=across(0, 5))
    assert part.report.seams == (HALVED + MET,)
    assert part.report.warnings == ()
    assert part.volume == pytest.approx(60 * pi - 1.5 * exit_of(2, 0.5), rel=1e-9)
    check_apart(part, rims=1)


@pytest.mark.parametrize(
    ("body", "volume", "way"),
    [(BAR, 20 * pi, TURNED), (OVAL, 30 * pi, HALVED), (BALL, 16 * pi / 3, TURNED),
     (OVOID, 32 * pi / 3, HALVED)],
)  # fmt: skip
def test_a_plane_through_the_seam(body: str, volume: float, way: str) -> None:
    """It runs along the seam, and through both poles of a ball."""
    part = built("cut(a, b)", a=body, b=BEHIND)
    assert part.report.seams == (way + MET,)
    assert part.report.warnings == ()
    assert part.volume == pytest.approx(volume, rel=1e-10)
    assert not any("piece" in face.name for face in part.report.faces) or way == HALVED


def test_a_hole_in_a_ball_away_from_its_seam() -> None:
    """Of a face from pole to pole the file does not tell which side of the hole it is."""
    part = built("cut(a, b)", a=BALL, b="[-6*u, w*cos(2*pi*v)/2, w*sin(2*pi*v)/2]")
    assert part.report.seams == (HALVED + BORED,)
    assert part.report.warnings == ()
    assert part.volume == pytest.approx(32 * pi / 3 - over_a_disc(0, 0, 0.5, 1) / 2, rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("body", [BALL, OVOID])
def test_a_hole_along_the_axis_leaves_a_face_whole(body: str) -> None:
    """Its poles are gone, its rims go all the way round and begin at the seam."""
    scale = 1 if body == BALL else 2
    part = built("cut(a, b)", a=body, b=upright(0, 0))
    assert (part.report.seams, part.report.warnings) == ((), ())
    assert len(part.report.faces) == 2
    whole = 32 * pi / 3 * scale
    assert part.volume == pytest.approx(whole - over_a_disc(0, 0, 0.5, scale), rel=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("off", [0.0, 1e-3])
def test_a_rim_through_or_beside_the_pole_of_a_ball(off: float) -> None:
    part = built("cut(a, b)", a=BALL, b=upright(0.5 + 4 * off, 0))
    assert part.report.seams == (HALVED + MET,)
    assert part.report.warnings == ()
    taken = over_a_disc(0.5 + 4 * off, 0, 0.5, 1)
    assert part.volume == pytest.approx(32 * pi / 3 - taken, rel=1e-9)


@pytest.mark.parametrize("off", [1e-3, 1e-5, 1e-7, 1e-9])
def test_a_plane_beside_the_pole_of_a_ball(off: float) -> None:
    """At 1e-5 the kernel had found nothing in common, and the ball stayed whole."""
    part = built("cut(a, b)", a=BALL, b=f"[20*(u - 1/2), {4 * off} + 10*v, 30*(w - 1/2)]")
    assert part.report.seams == (TURNED + MET,)
    assert part.report.warnings == ()
    assert part.volume == pytest.approx(pi / 3 * (2 + 4 * off) ** 2 * (4 - 4 * off), rel=1e-8)


def test_what_the_kernel_does_not_cut_is_refused() -> None:
    """Beside the pole of an ovoid it finds nothing in common, and all volumes would add up."""
    with pytest.raises(KernelError, match="nothing that the bodies have in common"):
        built("cut(a, b)", a=OVOID, b="[20*(u - 1/2), 4e-7 + 10*v, 30*(w - 1/2)]")


@pytest.mark.slow
def test_copies_are_looked_at_where_they_lie() -> None:
    """Only one of six holes crosses the tank's seam, and its own seam none."""
    part = built("cut(a, polar(b, 6))", a=TANK, b="[1 + 3*u, w*cos(2*pi*v)/2, 5 + w*sin(2*pi*v)/2]")
    assert part.report.seams == (TURNED + MET,)
    assert part.report.warnings == ()
    wall = 10 * pi * (2.25**2 - 2**2)
    taken = exit_of(2.25, 0.5) - exit_of(2, 0.5)
    assert part.volume == pytest.approx(wall - 6 * taken, rel=1e-9)
    check_apart(part, rims=12)


def test_what_is_not_met_stays_as_it_is() -> None:
    part = built("cut(a, b)", a=BAR, b="[-6*u, w*cos(2*pi*v)/2, 5 + w*sin(2*pi*v)/2]")
    assert (part.report.seams, part.report.warnings) == ((), ())
    check_apart(part, rims=1)


@pytest.mark.slow
def test_files_of_turned_and_of_halved_bodies_are_verified(tmp_path: Path) -> None:
    for number, body in enumerate((BAR, OVAL)):
        equations = bodies_of("cut(a, b)", a=body, b=across(0, 5))
        path = tmp_path / f"{number}.step"
        pc.compile_equation(equations).write(path)
        found = verification(parse_step(path.read_bytes()), equations)
        assert found.differences == ()


def test_a_turned_model_is_the_same_solid() -> None:
    """The volume within a half space through the axis is, for any turn about it."""
    body = built("cut(a, b)", a=TANK, b=across(0, 5)).bodies["a"]
    about = roundness(body.model)
    assert about is not None
    assert about.axis is not None
    np.testing.assert_allclose(np.abs(about.axis), [0, 0, 1], atol=1e-15)
    model = turned(body.model, about.centre, about.turn(1.0))
    before = np.linalg.norm(body.model.vertices[:, :2], axis=1)
    assert len(before) == 4
    np.testing.assert_allclose(np.linalg.norm(model.vertices[:, :2], axis=1), before, atol=1e-15)
    np.testing.assert_allclose(model.vertices[:, 2], body.model.vertices[:, 2], atol=1e-15)


def test_only_faces_that_come_round_to_themselves_are_halved() -> None:
    """A prism closes in several pieces, none of which does; cut, they would bear others' names."""
    hexagon = pc.read_template("bolt").bind().equations["hexagon"]
    analysis = analyse(hexagon)
    assert len(analysis.bounds[0]) == 7
    assert halved(analysis) is analysis
    assert len(halved(analyse(pc.read_template("hollow_cylinder").bind())).boundary.faces) == 8


def test_no_place_is_classified_where_boxes_of_bodies_are_apart(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The kernel takes milliseconds a place; only what is in another's box can be inside it."""
    monkeypatch.delattr(BRepClass3d_SolidClassifier, "Perform")
    assert built("union(a, b)", a="[u, v, w]", b="[u, v, 1 + w]").volume == pytest.approx(2)
    with pytest.raises(TypeError):
        built("union(a, b)", a="[u, v, w*(1 + u)/2]", b="[u, v, 1 - (1 - w)*(1 - u)/2]")
