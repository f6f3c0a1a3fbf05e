"""Several walls as one part: solids that share the faces between them."""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from itertools import pairwise
from math import pi

import numpy as np
import pytest
import trimesh
from consumers.gmsh_reader import read_all_in_gmsh
from consumers.step_file import check_solids
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.TopAbs import TopAbs_EDGE, TopAbs_FACE, TopAbs_ShapeEnum, TopAbs_VERTEX
from OCP.TopExp import TopExp
from OCP.TopoDS import TopoDS_Shape
from test_export_formats import read_3mf, read_iges, volume_of
from vtkmodules.util.numpy_support import vtk_to_numpy
from vtkmodules.vtkIOXML import vtkXMLPolyDataReader

import pc2cad as pc
from pc2cad.brep.kernel import IndexedMapOfShape
from pc2cad.brep.triangles import enclosed_volume
from pc2cad.channels import guide_functions
from pc2cad.channels.channel import ChannelError
from pc2cad.channels.limits import ChannelLimitError
from pc2cad.checked import CheckedMap, check_map
from pc2cad.compiler import compile_equation
from pc2cad.equation.point_equation import LayersError, PointEquation, point_equation
from pc2cad.errors import InputError, NotASolidError
from pc2cad.export.kernel import body, subshapes
from pc2cad.geometry.carriers import SplineSurface
from pc2cad.part import Part
from pc2cad.representation.boundary import represent
from pc2cad.representation.embedding import embed
from pc2cad.solidity.embedding.verdict import BuiltFacesMeetError
from pc2cad.solidity.injectivity import OverlappingMapError
from pc2cad.templates.file import parse_template

u, v, w = pc.parameters()
BENT = pc.polyline([(0, 0, 0), (10, 0, 0), (10, 8, 0)], 3)
LENGTH = 12 + 1.5 * pi
T = 2 * pi * u
RING = pc.point(10 * pc.cos(T), 10 * pc.sin(T), 2 * pc.sin(2 * T))
DUCT = pc.polygon([(2, 1), (-2, 1), (-2, -1), (2, -1)], v)


def pipe(**layers: object) -> PointEquation:
    return pc.channel(BENT, pc.ellipse(1, 1, v), layers, side="outside")


@pytest.fixture(scope="module")
def lagged() -> Part:
    return compile_equation(pipe(liner=0.1, steel=0.3, lagging=0.6))


def rings(*radii: float) -> list[float]:
    return [pi * (b**2 - a**2) for a, b in pairwise(radii)]


PARTS = {
    "pipe": (lambda: pipe(liner=0.1, steel=0.3, lagging=0.6), rings(1, 1.1, 1.4, 2), LENGTH),
    "cable": (
        lambda: pc.channel(BENT, pc.ellipse(1, 1, v), {"core": None, "sheath": 0.5}),
        [pi, *rings(1, 1.5)], LENGTH,
    ),
    "centred": (
        lambda: pc.channel(BENT, pc.ellipse(1, 1, v), {"a": 0.2, "b": 0.4}),
        rings(0.7, 0.9, 1.3), LENGTH,
    ),
    "duct": (
        lambda: pc.channel(BENT, DUCT, {"a": 0.1, "b": 0.2}, measured="normal", side="inside"),
        [3.6 * 1.6 - 3.4 * 1.4, 8 - 3.6 * 1.6], LENGTH,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", PARTS)
def test_volume_of_each_layer(name):
    make, areas, length = PARTS[name]
    part = compile_equation(make())
    assert part.report.evidence == "exact"
    found = [layer.volume for layer in part.report.layers]
    assert found == pytest.approx([area * length for area in areas], rel=1e-12)
    assert [x.solid_volume for x in part.report.layers] == pytest.approx(found, rel=1e-12)
    assert sum(found) == pytest.approx(part.report.equation.volume, rel=1e-14)
    assert [x.name for x in part.report.layers] == list(part.layers)


def indices(whole: TopoDS_Shape, shape: TopoDS_Shape, kind: TopAbs_ShapeEnum) -> set[int]:
    """The numbers in the whole of a shape's faces, edges or vertices, whatever way they turn."""
    numbers = IndexedMapOfShape()
    TopExp.MapShapes_s(whole, kind, numbers)
    return {numbers.FindIndex(found) for found in subshapes(shape, kind)}


def test_layers_share_faces_edges_and_vertices(lagged):
    whole = body(lagged.exportable())
    assert whole.ShapeType().name == "TopAbs_COMPSOLID"
    assert BRepCheck_Analyzer(whole).IsValid()
    layers = list(lagged.layers.values())
    # three stretches of the guide, two walls between layers, four rings at each of four stations
    assert [len(subshapes(whole, k)) for k in (TopAbs_FACE, TopAbs_EDGE, TopAbs_VERTEX)] == [
        18, 16 + 12, 16,
    ]  # fmt: skip
    first, second, third = (indices(whole, solid, TopAbs_FACE) for solid in layers)
    assert (len(first & second), len(second & third), len(first & third)) == (3, 3, 0)
    outer = indices(whole, lagged.shape, TopAbs_FACE)
    assert outer == (first | second | third) - (first & second) - (second & third)
    # what one layer leaves through a shared face, the other enters
    turns = [{f.TShape(): f.Orientation() for f in subshapes(x, TopAbs_FACE)} for x in layers]
    common = [t for t in turns[0] if t in turns[1]]
    assert len(common) == 3
    assert all(turns[0][t] != turns[1][t] for t in common)


def test_layers_of_a_closed_channel_have_a_void_each():
    equation = pc.channel(RING, pc.ellipse(1, 1, v), {"a": 0.2, "b": 0.3})
    part = compile_equation(equation, tolerance=1e-5)
    speed = guide_functions.function(pc.length(pc.diff(RING, u)))
    length = guide_functions.antiderivative(speed, (0, 1)).total
    areas = rings(0.75, 0.95, 1.25)
    for layer, area in zip(part.report.layers, areas, strict=True):
        assert layer.volume == pytest.approx(area * length, rel=1e-11)
        assert layer.solid_volume == pytest.approx(layer.volume, rel=1e-6)
        assert len(subshapes(part.layers[layer.name], TopAbs_FACE)) == 2
    assert [face.name for face in part.report.faces] == ["w=0", "w=1", "w=0.5"]


def test_layers_of_any_equation():
    """A ball of two shells round a core: the sphere between them is shared."""
    text = """
title = "ball"
[layers]
core = 1
shell = "k"
crust = "k/2"
[parameters]
k = 0.5
[solid]
x = "depth(w)*sin(pi*v)*cos(2*pi*u)"
y = "depth(w)*sin(pi*v)*sin(2*pi*u)"
z = "depth(w)*cos(pi*v)"
"""
    part = compile_equation(parse_template(text, "ball").bind({"k": 1}))
    assert {f.carrier for f in part.report.faces} == {"sphere"}
    radii = [0, 1, 2, 2.5]
    volumes = [4 / 3 * pi * (b**3 - a**3) for a, b in pairwise(radii)]
    assert [x.volume for x in part.report.layers] == pytest.approx(volumes, rel=1e-12)
    assert [x.area for x in part.report.layers] == pytest.approx(
        [4 * pi, 20 * pi, 41 * pi], rel=1e-12
    )


def nested(count: int) -> CheckedMap:
    """Walls one in another, each of whose arcs is deeper than all of them together are thick."""
    names = "\n".join(f"l{k} = 1" for k in range(count))
    return check_map(parse_template(f"""
title = "nested"
[layers]
{names}
[let]
r = "(100 + depth(w))*(1 + u/20)"
a = "2*pi*v"
[solid]
x = "r*cos(a)*(1 + cos(3*a)/20)"
y = "r*sin(a)*(1 + cos(3*a)/20)"
z = "200*u"
""", "nested").bind())  # fmt: skip


def test_faces_are_compared_where_they_have_a_solid_in_common():
    """Six layers more take some twice what three more do; with every two it is four times."""
    counts = []
    for count in (3, 6, 12):
        found = embed(checked := nested(count), represent(checked))
        assert found.proved, found.open
        counts.append(found.cells)
    assert counts[2] - counts[1] <= 3 * (counts[1] - counts[0])


def test_a_wall_that_is_built_across_others_is_refused():
    """It may reach beyond the next one: that one is compared with it."""
    model = represent(checked := nested(3))
    faces = list(model.faces)
    (index,) = [k for k, face in enumerate(faces) if face.name == "w=0.333333"]
    carrier = faces[index].carrier
    assert isinstance(carrier, SplineSurface)
    poles = carrier.poles.copy()
    middle = poles.shape[0] // 2
    poles[middle, :, :2] *= 1.03
    faces[index] = replace(faces[index], carrier=replace(carrier, poles=poles))
    with pytest.raises(BuiltFacesMeetError, match=r"w=0\.333333"):
        embed(checked, replace(model, faces=tuple(faces)))


def test_step_file_holds_named_solids(lagged, tmp_path):
    path = tmp_path / "lagged.step"
    lagged.write(path)
    found = check_solids(path)
    assert list(found) == ["liner", "steel", "lagging"]
    for layer in lagged.report.layers:
        solid = found[layer.name]
        assert solid.volume == pytest.approx(layer.volume, rel=1e-11)
        assert solid.area == pytest.approx(layer.area, rel=1e-11)
        assert solid.centroid == pytest.approx(layer.centroid, abs=1e-10)


@pytest.mark.parametrize("ending", ["igs", "stl", "3mf", "glb", "vtp"])
def test_other_formats_hold_the_whole(lagged, ending, tmp_path):
    path = tmp_path / f"lagged.{ending}"
    lagged.write(path)
    volume = sum(rings(1, 2)) * LENGTH
    if ending == "igs":
        assert volume_of(read_iges(path.read_bytes(), tmp_path)) == pytest.approx(volume, rel=1e-7)
    elif ending in ("stl", "glb"):
        mesh = trimesh.load(path)
        mesh = mesh if ending == "stl" else mesh.to_geometry()
        scale = 1 if ending == "stl" else 1e-3  # GLB is in metres
        assert mesh.volume == pytest.approx(volume * scale**3, rel=0.0101)
    elif ending == "3mf":
        _, thing = read_3mf(path.read_bytes())
        points = np.array([p.Coordinates[:] for p in thing.GetVertices()])
        triangles = np.array([t.Indices[:] for t in thing.GetTriangleIndices()])
        assert enclosed_volume(points, triangles) == pytest.approx(volume, rel=0.0101)
    else:
        reader = vtkXMLPolyDataReader()
        reader.SetFileName(str(path))
        reader.Update()
        points = vtk_to_numpy(reader.GetOutput().GetPoints().GetData())
        triangles = vtk_to_numpy(reader.GetOutput().GetPolys().GetConnectivityArray())
        assert enclosed_volume(points, triangles.reshape(-1, 3)) == pytest.approx(
            volume, rel=0.0101
        )


@pytest.mark.interop
def test_gmsh_meshes_the_layers_as_they_are(lagged, tmp_path):
    for ending in ("brep", "step"):
        lagged.write(tmp_path / f"lagged.{ending}")
    brep, step = read_all_in_gmsh([tmp_path / "lagged.brep", tmp_path / "lagged.step"])
    volume = lagged.report.equation.volume
    assert [x["volumes"] for x in (brep, step)] == [3, 3]
    assert [x["volume"] for x in (brep, step)] == pytest.approx([volume] * 2, rel=1e-9)
    # BREP keeps a shared face one face; STEP has no face that bounds two solids
    assert (brep["surfaces"], step["surfaces"]) == (18, 24)


@pytest.mark.interop
def test_tetrahedra_of_creased_sides_fill_the_whole(lagged):
    mesh = lagged.mesh(size=1.0, order=2, shape="tetrahedra")
    assert mesh.volume() == pytest.approx(lagged.report.equation.volume, rel=0.01)
    assert {"u=0", "w=1", "w=1 (piece 2 of u)", "u=0 (piece 1 of w)"} <= mesh.sides.keys()
    # each layer is a set of its own, and neighbours share the nodes between them
    assert list(mesh.layers) == [layer.name for layer in lagged.report.layers]
    nodes = {}
    for layer in lagged.report.layers:
        rows = mesh.blocks["tetra"][mesh.layers[layer.name]["tetra"]]
        a, b, c, d = (mesh.points[rows[:, k]] for k in range(4))
        volume = np.linalg.det(np.stack((b - a, c - a, d - a), axis=1)).sum() / 6
        assert volume == pytest.approx(layer.volume, rel=0.1)
        nodes[layer.name] = set(rows.ravel().tolist())
    first, second, third = nodes.values()
    assert first & second
    assert second & third
    assert not first & third


def test_walls_that_change():
    """Between r and r + δ(u) a layer has the area π(2rδ + δ²): V = 5π·∫(4δ + δ²) du."""
    wall = {"a": 0.2 * (1 + u), "b": 0.3 + 0.1 * pc.cos(4 * pi * v)}
    line = pc.point(0, 0, 5 * u)
    part = compile_equation(pc.channel(line, pc.ellipse(2, 2, v), wall, side="outside"))
    first, second = part.report.layers
    # means over u: δ = 0.3, δ² = 0.04·7/3
    assert first.volume == pytest.approx(5 * pi * (4 * 0.3 + 0.28 / 3), rel=1e-12)
    # b lies on r = 2 + δ; the mean of its square is 0.3² + 0.1²/2
    assert second.volume == pytest.approx(5 * pi * (2 * 2.3 * 0.3 + 0.095), rel=1e-12)


@pytest.mark.parametrize(
    ("make", "error", "message"),
    [
        (lambda: pipe(a=1), LayersError, "layers are two or more, and here are 1"),
        (lambda: pipe(a=1, b=w), LayersError, "may depend on u and v, not on w"),
        (lambda: pipe(a=1, b=None), ChannelError, "only the first layer can fill the section"),
        (lambda: pc.channel(BENT, DUCT, {"a": None, "b": 1}, side="inside"), ChannelError,
         "layers on a filled section lie outside it"),
        (lambda: compile_equation(point_equation((u, v, w)).layered("ab")), LayersError,
         r"there are 2 layers \(a, b\), and M has 0 creases in w between them"),
        (lambda: point_equation((u, v, w), {"w": (0, 2)}).layered("ab"), LayersError,
         "the domain of w is another one"),
        (lambda: point_equation((u, v, w)).layered("aa"), LayersError, "each another"),
    ],
)  # fmt: skip
def test_what_makes_no_layers_is_refused(make, error, message):
    assert issubclass(error, InputError)
    with pytest.raises(error, match=message):
        make()


def test_layers_that_cover_one_another_are_refused_as_such():
    turns = pc.channel(pc.helix(5, 2.2, 3), pc.ellipse(0.9, 0.9, v), {"core": None, "skin": 0.4})
    with pytest.raises(ChannelLimitError, match="comes within 2"):
        compile_equation(turns)
    pinched = parse_template("""
title = "a throat of no radius"
[layers]
liner = 1
jacket = 2
[let]
r = "(u - 1/2)^2 + depth(w)"
[solid]
x = "r*cos(2*pi*v)"
y = "r*sin(2*pi*v)"
z = "3*u"
""", "pinched")  # fmt: skip
    with pytest.raises(OverlappingMapError, match="covers itself, or touches") as refused:
        compile_equation(pinched.bind())
    assert "for w" not in str(refused.value)  # layers share all of it


def test_layers_that_cover_themselves_are_refused_for_that():
    """A part of the box, which is tried for advice, has not all of the layers."""
    spiral = parse_template("""
title = "Two layers of a strip that goes round more than once"
[layers]
a = 1
b = 1
[solid]
x = "(2 + depth(w))*cos(7*u)"
y = "(2 + depth(w))*sin(7*u)"
z = "v + u/10"
""", "spiral").bind()  # fmt: skip
    with pytest.raises(OverlappingMapError, match=r"mm deep or more.*it does not for u up to"):
        compile_equation(spiral)


@pytest.mark.parametrize("place", [(Fraction(1, 2), Fraction(1, 4)), (Fraction(3, 8), 0.3)])
def test_faces_between_layers_that_touch_are_refused_for_that(place):
    """Exact faces that meet are the equation's, however near a search for the place comes."""
    wall = sum(pc.sin(pc.pi * (x - at)) ** 2 for x, at in zip((u, v), place, strict=True))
    ring = pc.frame(pc.point(5 * pc.cos(T), 5 * pc.sin(T), 0), "direction", pc.vector(0, 0, 1))
    layers = {"core": None, "gap": 0.3 * wall, "sheath": 0.2}
    part = replace(pc.channel(ring, pc.ellipse(0.5, 0.5, v), layers), guide=None, frame="")
    with pytest.raises(OverlappingMapError, match="covers itself, or touches"):
        compile_equation(part)


@pytest.mark.parametrize(
    ("thickness", "message"),
    [
        ("abs(u - 1/2)", r"the edge u=0\.5, w=0 is used 4 times in layer 1 .* comes to nothing"),
        ("(u - 1/2)^2 + v^2", r"or touches: u = 0\.5, v = 0, w = .* both lie at"),
    ],
)
def test_a_layer_that_comes_to_nothing_inside_is_refused_with_the_place(thickness, message):
    layered = f"""
[layers]
thin = "{thickness}"
thick = "1"
[solid]
x = "u"
y = "v"
z = "depth(w)"
"""
    with pytest.raises(NotASolidError, match=message):
        compile_equation(parse_template(f'title = "T"{layered}', "T").bind())
