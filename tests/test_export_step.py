"""STEP: what goes in comes back, whatever unit, schema and name, and always as the same bytes."""

from __future__ import annotations

import dataclasses
import io
import math
import re
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pytest
from OCP.BRepBuilderAPI import (
    BRepBuilderAPI_MakeFace,
    BRepBuilderAPI_MakePolygon,
    BRepBuilderAPI_Transform,
)
from OCP.BRepCheck import BRepCheck_Analyzer
from OCP.BRepGProp import BRepGProp
from OCP.BRepPrimAPI import BRepPrimAPI_MakeBox, BRepPrimAPI_MakePrism
from OCP.gp import gp_Pnt, gp_Trsf, gp_Vec
from OCP.GProp import GProp_GProps
from OCP.Interface import Interface_Static
from OCP.Message import Message
from OCP.STEPCAFControl import STEPCAFControl_Controller, STEPCAFControl_Reader
from OCP.STEPControl import STEPControl_Reader
from OCP.TCollection import TCollection_ExtendedString
from OCP.TDataStd import TDataStd_Name
from OCP.TDocStd import TDocStd_Document
from OCP.TopLoc import TopLoc_Location
from OCP.TopoDS import TopoDS_Solid
from OCP.XCAFDoc import XCAFDoc_Area, XCAFDoc_Centroid, XCAFDoc_DocumentTool, XCAFDoc_Volume
from steputils import p21
from test_export_shapes import SHAPES, exportable, faces_of, spline_poles

from pc2cad import __version__, compile_equation, read_template
from pc2cad.brep.kernel import LabelSequence, as_solid, as_wire
from pc2cad.errors import InputError, KernelError
from pc2cad.export import part21, step
from pc2cad.export.model import UNITS_IN_MM, ExportOptions, GeometricProperties, NamedFace
from pc2cad.templates.shipped import template_paths

FIXED = ExportOptions(timestamp="2026-01-31T12:00:00Z")


def read_mm(data: bytes):
    """The shape in the file, in millimetres."""
    with step.quiet_kernel():
        reader = STEPControl_Reader()
        reader.ReadStream("x", io.BytesIO(data))
        reader.TransferRoots()
        return reader.OneShape()


def volume_of(shape) -> float:
    found = GProp_GProps()
    BRepGProp.VolumeProperties_s(shape, found)
    return found.Mass()


class Document:
    """The file as a reader with names and validation properties sees it, in millimetres."""

    def __init__(self, data: bytes):
        STEPCAFControl_Controller.Init_s()
        with step.quiet_kernel(), step.kernel_parameters({"read.stepcaf.subshapes.name": 1}):
            reader = STEPCAFControl_Reader()
            reader.SetNameMode(True)
            reader.SetPropsMode(True)
            reader.ReadStream("x", io.BytesIO(data))
            self.document = TDocStd_Document(TCollection_ExtendedString("XmlOcaf"))
            XCAFDoc_DocumentTool.SetLengthUnit_s(self.document, 0.001)
            reader.Transfer(self.document)
        self.tool = XCAFDoc_DocumentTool.ShapeTool_s(self.document.Main())
        labels = LabelSequence()
        self.tool.GetFreeShapes(labels)
        assert labels.Length() == 1
        self.label = labels.Value(1)

    def name(self, label=None) -> str:
        found = TDataStd_Name()
        assert (label or self.label).FindAttribute(TDataStd_Name.GetID_s(), found)
        return found.Get().ToExtString()

    def figures(self):
        volume, area, centroid = XCAFDoc_Volume(), XCAFDoc_Area(), XCAFDoc_Centroid()
        for attribute in (volume, area, centroid):
            assert self.label.FindAttribute(type(attribute).GetID_s(), attribute)
        return volume.Get(), area.Get(), centroid.Get().Coord()

    def face_names(self) -> set[str]:
        labels = LabelSequence()
        self.tool.GetSubShapes_s(self.label, labels)
        return {self.name(labels.Value(i)) for i in range(1, labels.Length() + 1)}


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("schema", ["AP242", "AP214"])
def test_reads_back_with_the_same_volume_and_faces(shape, schema):
    item = exportable(shape)
    back = read_mm(step.encode(item, ExportOptions(step_schema=schema)))
    assert volume_of(back) == pytest.approx(volume_of(item.solid), rel=1e-12)
    assert len(faces_of(back)) == len(faces_of(item.solid))


def test_poles_come_back_bit_for_bit():
    item = exportable("spline box")
    back = read_mm(step.encode(item, FIXED))
    assert np.array_equal(spline_poles(back), spline_poles(item.solid))


@pytest.mark.parametrize(
    "offset", [(1000.0, -2000.0, 500.0), (1e6 / 3, 0.1, -1e5 / 7)], ids=["near", "far"]
)
def test_poles_far_from_the_origin_come_back_bit_for_bit(offset):
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(*offset))
    solid = exportable("spline box").solid
    moved = as_solid(BRepBuilderAPI_Transform(solid, move, True).Shape())
    item = dataclasses.replace(exportable("spline box"), solid=moved, faces=())
    assert np.array_equal(spline_poles(read_mm(step.encode(item, FIXED))), spline_poles(moved))


@pytest.mark.parametrize("schema", ["AP242", "AP214"])
@pytest.mark.parametrize("unit", UNITS_IN_MM)
def test_a_unit_cube_is_one_unit_large_in_millimetres(unit, schema):
    cube = BRepPrimAPI_MakeBox(1.0, 1.0, 1.0).Solid()
    figures = GeometricProperties(1.0, 6.0, (0.5, 0.25, 0.5))
    item = dataclasses.replace(
        exportable("box"), solid=cube, units=unit, faces=(), properties=figures
    )
    data = step.encode(item, dataclasses.replace(FIXED, step_schema=schema))
    size = UNITS_IN_MM[unit]
    assert volume_of(read_mm(data)) == pytest.approx(size**3, rel=1e-14)
    volume, area, centroid = Document(data).figures()
    assert volume == pytest.approx(size**3, rel=1e-14)
    assert area == pytest.approx(6.0 * size**2, rel=1e-14)
    assert centroid == pytest.approx((size / 2, size / 4, size / 2), rel=1e-14)
    # the numbers of the file are those of the model
    points = re.findall(rb"CARTESIAN_POINT\('',\(([^,)]*),([^,)]*),([^,)]*)\)", data)
    assert {number.strip() for point in points for number in point} == {b"0.", b"1."}


def test_units_of_one_file_do_not_leak_into_the_next():
    metre = dataclasses.replace(exportable("box"), units="m")
    first = step.encode(exportable("box"), FIXED)
    step.encode(metre, FIXED)
    assert step.encode(exportable("box"), FIXED) == first


def test_a_file_is_the_same_after_any_others_and_after_errors():
    plain = [exportable(shape) for shape in SHAPES]
    red = tuple(dataclasses.replace(face, colour=(1.0, 0.0, 0.0)) for face in plain[0].faces)
    changes = ({"faces": red}, {"faces": ()}, {"units": "in"}, {"name": "other"})
    items = plain + [dataclasses.replace(plain[0], **change) for change in changes]
    kinds = [dataclasses.replace(FIXED, step_schema=schema) for schema in ("AP242", "AP214")]
    alone = {}
    for i, item in enumerate(items):
        for kind in kinds:
            # a thread has sessions of its own
            with ThreadPoolExecutor(1) as fresh:
                alone[i, kind.step_schema] = fresh.submit(step.encode, item, kind).result()
    assert len(set(alone.values())) == len(alone) == 2 * (len(SHAPES) + 4)
    for turn in range(3):
        for i in np.random.default_rng(turn).permutation(len(items)):
            for kind in kinds:
                assert step.encode(items[i], kind) == alone[i, kind.step_schema]
            strange = dataclasses.replace(items[i], faces=plain[(i + 1) % len(plain)].faces)
            with pytest.raises(KernelError):
                step.encode(strange, FIXED)


def test_a_text_that_does_not_read_back_leaves_nothing_behind(monkeypatch):
    item = exportable("box")
    data = step.encode(item, FIXED)
    for word, other in ((b"CLOSED_SHELL", b"CLOSED_SHALL"), (b"PLANE(", b"PLAIN(")):
        with monkeypatch.context() as patch:
            patch.setattr(part21, "finish", lambda *_: data.replace(word, other))  # noqa: B023
            with pytest.raises(KernelError):
                step.encode(item, FIXED)
        assert step.encode(item, FIXED) == data


@pytest.mark.parametrize(
    ("schema", "text"),
    [("AP242", "AP242_MANAGED_MODEL_BASED_3D_ENGINEERING"), ("AP214", "AUTOMOTIVE_DESIGN")],
)
def test_header(schema, text):
    item = dataclasses.replace(exportable("box"), description="first line\nsecond line")
    data = step.encode(item, dataclasses.replace(FIXED, step_schema=schema)).decode("ascii")
    header = p21.loads(data).header
    assert header["FILE_SCHEMA"].params[0][0].startswith(text)
    description, level = header["FILE_DESCRIPTION"].params
    assert description[:2] == ("first line", "second line")
    assert "1e-07 mm" in description[2]
    assert level == "2;1"
    name, time, author, organisation, preprocessor, system, _ = header["FILE_NAME"].params
    assert (name, time) == ("box", "2026-01-31T12:00:00Z")
    assert (author[0], organisation[0]) == ("", "")
    assert preprocessor.startswith(("OCCT 7.", "OCCT 8."))
    assert system == f"pc2cad {__version__}"
    assert "Open CASCADE" not in data


def test_product_and_body_carry_the_name_and_faces_theirs():
    data = step.encode(exportable("box"), FIXED)
    assert b"PRODUCT('box','box','',(" in data
    assert b"MANIFOLD_SOLID_BREP('box'," in data
    assert re.findall(rb"ADVANCED_FACE\('([^']*)'", data) == [b"side=%d" % i for i in range(6)]
    document = Document(data)
    assert document.name() == "box"
    assert {f"side={i}" for i in range(6)} <= document.face_names()


@pytest.mark.parametrize(
    "name",
    [
        "d'eau",
        "5'",
        "a','b",
        "a')",
        "''",
        "back\\slash",
        "\\X2\\00FC\\X0\\",
        "Größe Δ 体",
        "smile \U0001f600 end",
        "mixed Ü\U0001f600'ß')",
        "a;b /*c*/ #12=ENDSEC;",
        "%d %s \"quoted\" @F0@ '@P@'",
    ],
)
def test_names_come_back_unchanged(name):
    item = exportable("box")
    faces = (dataclasses.replace(item.faces[0], name=name), *item.faces[1:])
    data = step.encode(dataclasses.replace(item, name=name, faces=faces), FIXED)
    assert data.isascii()
    document = Document(data)
    assert document.name() == name
    assert name in document.face_names()


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("two\nlines\r\n\tand tab", "two lines and tab"),
        ("bell\x07nul\x00end", "bell nul end"),
        ("half a pair \ud800", "half a pair \ufffd"),
        ("  ", "unnamed"),
        ("x" * 5000, "x" * 199 + "…"),
    ],
)
def test_unprintable_and_long_names_are_made_printable(name, shown):
    data = step.encode(dataclasses.replace(exportable("box"), name=name), FIXED)
    assert Document(data).name() == shown


def test_a_long_description_is_cut_into_header_strings():
    item = dataclasses.replace(exportable("box"), description="word " * 1000 + "\n" + "y" * 600)
    data = step.encode(item, FIXED).decode("ascii")
    description = p21.loads(data).header["FILE_DESCRIPTION"].params[0]
    assert max(map(len, description)) <= 250
    assert " ".join(description).count("word") == 1000
    assert "".join(description).count("y" * 100) == 6


def test_colours_are_written_without_noise():
    item = exportable("box")
    faces = (dataclasses.replace(item.faces[2], colour=(1.0, 0.5, 0.1)),)
    data = step.encode(dataclasses.replace(item, faces=faces), FIXED)
    assert re.findall(rb"COLOUR_RGB\('',([^)]*)\)", data) == [b"1.,0.5,0.1"]


def test_parameters_of_the_process_and_printers_are_put_back():
    STEPCAFControl_Controller.Init_s()
    names = (*step._PARAMETERS, "write.step.schema", "write.step.unit")
    Interface_Static.SetIVal_s("write.step.schema", 3)
    Interface_Static.SetCVal_s("write.step.unit", "FT")
    Interface_Static.SetIVal_s("write.surfacecurve.mode", 0)
    printers = Message.DefaultMessenger_s().Printers().Size()
    try:
        before = {name: Interface_Static.CVal_s(name) for name in names}
        step.encode(dataclasses.replace(exportable("box"), units="in"), FIXED)
        assert {name: Interface_Static.CVal_s(name) for name in names} == before
        bad = dataclasses.replace(
            exportable("box"), faces=(NamedFace("x", exportable("torus").faces[0].face),)
        )
        with pytest.raises(KernelError, match="not a face of the solid"):
            step.encode(bad, FIXED)
        assert {name: Interface_Static.CVal_s(name) for name in names} == before
        assert Message.DefaultMessenger_s().Printers().Size() == printers
    finally:
        Interface_Static.SetIVal_s("write.step.schema", 4)
        Interface_Static.SetCVal_s("write.step.unit", "MM")
        Interface_Static.SetIVal_s("write.surfacecurve.mode", 1)


def test_an_unknown_parameter_is_refused():
    with (
        pytest.raises(KernelError, match=r"no\.such\.parameter"),
        step.kernel_parameters({"no.such.parameter": 1}),
    ):
        pass


def test_the_fifth_file_of_a_process_equals_the_first():
    files = {step.encode(exportable("hollow sphere"), FIXED) for _ in range(5)}
    assert len(files) == 1


SCRIPT = """
import sys
from pc2cad.export import step
from pc2cad.export.model import ExportOptions
from test_export_shapes import exportable
ballast = [bytearray(n) for n in range(int(sys.argv[1]))]
for other in sys.argv[2:]:
    step.encode(exportable(other), ExportOptions())
sys.stdout.buffer.write(b"BEGIN" + step.encode(exportable("spline box"), ExportOptions()))
"""


@pytest.mark.slow
def test_every_process_writes_the_same_bytes_and_nothing_to_stdout():
    root = Path(__file__).parents[1]
    environment = {"SOURCE_DATE_EPOCH": "1700000000", "PYTHONPATH": f"{root}:{root / 'tests'}"}
    outputs = [
        subprocess.run(
            [sys.executable, "-c", SCRIPT, *arguments],
            cwd=root,
            env=environment,
            capture_output=True,
            check=True,
        )
        for arguments in (["0"], ["5000", "torus", "box"])
    ]
    assert outputs[0].stdout == outputs[1].stdout
    assert outputs[0].stdout.startswith(b"BEGINISO-10303-21;")
    assert b"'2023-11-14T22:13:20Z'" in outputs[0].stdout
    assert outputs[0].stderr == b""


def test_the_solid_is_not_changed():
    item = exportable("spline box")
    before = spline_poles(item.solid).copy()
    step.encode(item, FIXED)
    assert np.array_equal(spline_poles(item.solid), before)


@pytest.mark.parametrize("null", [None, TopoDS_Solid()], ids=["None", "null"])
def test_a_missing_solid_is_refused(null):
    with pytest.raises(KernelError, match="no solid"):
        step.encode(dataclasses.replace(exportable("box"), solid=null), FIXED)


def test_another_kind_of_shape_is_refused():
    face = exportable("box").faces[0].face
    with pytest.raises(KernelError, match="the shape is a face"):
        step.encode(dataclasses.replace(exportable("box"), solid=face, faces=()), FIXED)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_coordinates_that_are_not_finite_are_refused(bad):
    solid = BRepPrimAPI_MakeBox(gp_Pnt(bad, 0.0, 0.0), 1.0, 1.0, 1.0).Solid()
    with pytest.raises(KernelError):
        step.encode(dataclasses.replace(exportable("box"), solid=solid, faces=()), FIXED)


def test_an_inside_out_solid_is_refused():
    solid = as_solid(exportable("spline box").solid.Reversed())
    item = dataclasses.replace(exportable("spline box"), solid=solid, faces=())
    with pytest.raises(KernelError, match="inside out"):
        step.encode(item, FIXED)


def test_a_face_named_twice_is_refused():
    item = exportable("box")
    with pytest.raises(KernelError):
        step.encode(dataclasses.replace(item, faces=(item.faces[0],) * 2), FIXED)


def test_a_solid_with_a_location_is_refused():
    move = gp_Trsf()
    move.SetTranslation(gp_Vec(5.0, 6.0, 7.0))
    solid = as_solid(exportable("box").solid.Moved(TopLoc_Location(move)))
    with pytest.raises(KernelError, match="location"):
        step.encode(dataclasses.replace(exportable("box"), solid=solid, faces=()), FIXED)


@pytest.mark.parametrize(
    "value",
    [0.1, 1 / 3, -2.5e-7, 1e22, 6e-17, 123456.789, 1e5, 0.0, -1e-300, 1.7e308, 5e-324, 60.0],
)
def test_numbers_keep_every_bit(value):
    short = part21.real(b"%.17E" % value)
    assert float(short) == value
    assert re.fullmatch(rb"-?\d+\.\d*(E[+-]?\d+)?", short)
    assert len(short) <= 24


def test_a_text_without_data_is_refused():
    header = part21.Header("n", [""], "t", "s")
    with pytest.raises(KernelError, match="no data section"):
        part21.finish(b"ISO-10303-21;", {}, header)


@pytest.mark.parametrize("number", [b"NAN", b"-INF", b"1.E+308"])
def test_a_text_with_a_number_that_is_not_finite_is_refused(number):
    text = b"FILE_SCHEMA(('X'));DATA;\n#1 = POINT('',(0.," + number + b"));\nENDSEC;"
    with pytest.raises(KernelError, match="not finite"):
        part21.finish(text, {}, part21.Header("n", [""], "t", "s"))


@pytest.mark.parametrize(
    ("mark", "message"), [("@other@", "unknown mark"), ("plain", "did not write these names")]
)
def test_lost_and_unknown_marks_are_refused(mark, message):
    text = f"FILE_SCHEMA(('X'));DATA;\n#1 = FACE('{mark}');\nENDSEC;".encode()
    with pytest.raises(KernelError, match=message):
        part21.finish(text, {"P": "part"}, part21.Header("n", [""], "t", "s"))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        ((b"ISO-10303-21;", b""), "cannot read"),
        ((b"MANIFOLD_SOLID_BREP(", b"SHELL_BASED_SURFACE_MODEL("), "0 solids"),
        ((b"CARTESIAN_POINT('',(10.,", b"CARTESIAN_POINT('',(10.001,"), "reads back"),
        ((b"ADVANCED_FACE(", b"ADVANCED_FACT("), "faces"),
    ],
)
def test_a_damaged_text_is_refused(monkeypatch, damage, message):
    finish = part21.finish
    monkeypatch.setattr(part21, "finish", lambda *args: finish(*args).replace(*damage, 1))
    with pytest.raises(KernelError, match=message):
        step.encode(exportable("box"), FIXED)


def test_an_edge_that_crosses_itself_is_refused(monkeypatch):
    # the reader is told not to look for such edges: the checker does
    part = compile_equation(read_template(template_paths()["channel_ellipse"]).bind())

    def crossed(*args):
        text = finish(*args)
        curve = text[text.index(b"B_SPLINE_CURVE_WITH_KNOTS(") :]
        poles = re.findall(rb"#\d+", curve[: curve.index(b")")])
        one, other = (
            re.search(pole + rb" = CARTESIAN_POINT\('',(\([^)]*\))", text).group(1)
            for pole in (poles[5], poles[19])
        )
        return text.replace(one, b"@").replace(other, one).replace(b"@", other)

    finish = part21.finish
    monkeypatch.setattr(part21, "finish", crossed)
    with pytest.raises(KernelError, match="not valid"):
        step.encode(part.exportable(), FIXED)


def test_wires_that_cross_are_refused():
    # the reader is told not to split edges there: it makes several faces, or the checker refuses
    def rectangle(x, y, width, height):
        polygon = BRepBuilderAPI_MakePolygon()
        for corner in ((x, y), (x + width, y), (x + width, y + height), (x, y + height)):
            polygon.Add(gp_Pnt(*corner, 0.0))
        polygon.Close()
        return polygon.Wire()

    base = BRepBuilderAPI_MakeFace(rectangle(0, 0, 4, 4), True)
    base.Add(as_wire(rectangle(3, 1, 3, 2).Reversed()))
    solid = as_solid(BRepPrimAPI_MakePrism(base.Face(), gp_Vec(0, 0, 2)).Shape())
    assert not BRepCheck_Analyzer(solid).IsValid()
    with pytest.raises(KernelError, match=r"not valid|a solid is needed|in 2 shells"):
        step.encode(dataclasses.replace(exportable("box"), solid=solid, faces=()), FIXED)


def test_an_edge_off_its_faces_is_refused(monkeypatch):
    # the reader is told not to raise tolerances of solids: it does for wires, or it is not valid
    part = compile_equation(read_template(template_paths()["channel_ellipse"]).bind())

    def moved(*args):
        text = finish(*args)
        curve = text[text.index(b"B_SPLINE_CURVE_WITH_KNOTS(") :]
        pole = re.findall(rb"#\d+", curve[: curve.index(b")")])[12]
        head, x = re.search(rb"(" + pole + rb" = CARTESIAN_POINT\('',\()([^,]*)", text).groups()
        return text.replace(head + x, b"%s%.9f" % (head, float(x) + 1e-5))

    finish = part21.finish
    monkeypatch.setattr(part21, "finish", moved)
    with pytest.raises(KernelError, match=r"not valid|gaps of up to"):
        step.encode(part.exportable(), FIXED)


def test_a_bad_source_date_epoch_is_named(monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "yesterday")
    with pytest.raises(InputError, match="SOURCE_DATE_EPOCH"):
        step.encode(exportable("box"), ExportOptions())
