"""Names from templates, paths and scripts: checked, cleaned, escaped, and read back by others."""

from __future__ import annotations

import csv
import io
import json
import os
import re
import shutil
import struct
import subprocess
import sys
import zipfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from html.parser import HTMLParser
from itertools import pairwise
from pathlib import Path
from string import ascii_letters
from typing import Any
from urllib.parse import unquote
from xml.etree import ElementTree

import h5py
import meshio
import numpy as np
import pytest
import trimesh
import vtk
from hostile_texts import TEXTS, any_text
from hypothesis import example, given, settings
from hypothesis import strategies as st

from pc2cad.checked import check_map
from pc2cad.cli.main import main
from pc2cad.compiler import compile_equation, mesh_equation, spline_equation
from pc2cad.equation.point_equation import LayersError, PointEquation, point_equation
from pc2cad.errors import InputError
from pc2cad.export.mesh_files import MESH_FORMATS, write_mesh
from pc2cad.export.model import Exportable, ExportOptions
from pc2cad.export.point_files import POINT_FORMATS
from pc2cad.export.registry import FORMATS, format_for
from pc2cad.export.spline_files import SPLINE_FORMATS, write_splines
from pc2cad.mesh.meshing import MeshOptions
from pc2cad.mesh.volume_mesh import VolumeMesh
from pc2cad.picture.image import svg
from pc2cad.picture.overlay import Text
from pc2cad.sampling.interior import PointSet, sample_uniform
from pc2cad.studies.plan import Plan
from pc2cad.studies.table import to_csv
from pc2cad.studies.variant import Outcome
from pc2cad.templates.file import parse_template
from pc2cad.trust.names import (
    NameNotAllowedError,
    cell,
    check_file_name,
    clean,
    is_identifier,
    is_label,
    percent,
    told_apart,
    visible,
    words,
)
from pc2cad.viewer.page import Slider, Variant, page

LAYERED = """
title = "Box"
[layers]
core = 1
"Ober-Schicht 2.1" = 2
[solid]
x = "u"
y = "v"
z = "depth(w)"
"""
#: for readers of formats that VTK reads only through files
VTK = {".vtu": vtk.vtkXMLUnstructuredGridReader, ".vtk": vtk.vtkUnstructuredGridReader,
       ".vtp": vtk.vtkXMLPolyDataReader}  # fmt: skip


@pytest.fixture(scope="module")
def layered() -> PointEquation:
    return parse_template(LAYERED, "box").bind({})  # type: ignore[return-value]


@pytest.fixture(scope="module")
def mesh(layered: PointEquation) -> VolumeMesh:
    return mesh_equation(layered, MeshOptions(cells=(1, 1, 2)))[0]


@pytest.fixture(scope="module")
def exportable() -> Exportable:
    u, v, w = (pc_parameter(name) for name in "uvw")
    return compile_equation(point_equation((u, 2 * v, 3 * w))).exportable()


def pc_parameter(name: str) -> Any:
    import pc2cad as pc

    return dict(zip("uvw", pc.parameters(), strict=True))[name]


# -- checks and escapes ----------------------------------------------------------------------------


@given(any_text)
@settings(deadline=None, max_examples=50)
def test_what_is_cleaned_shown_or_escaped_has_nothing_to_move_a_terminal(text: str) -> None:
    for made in (clean(text), visible(text), percent(text, "*", limit=10**6), cell(text)):
        assert made.isprintable()
    assert clean(clean(text)) == clean(text)
    assert len(clean(text, 10)) <= 10
    assert not cell(text).startswith(("=", "+", "-", "@", "\t", "\r"))


@given(any_text)
@settings(deadline=None, max_examples=50)
def test_percents_give_the_name_back(text: str) -> None:
    made = percent(text, '*"', limit=10**6, words=("end_header", "solid"))
    assert made.isascii()
    assert not set(made) & set('*"')
    assert "end_header" not in made.lower()
    assert unquote(made) == text.encode("utf-8", "replace").decode()
    assert len(percent(text, "", limit=40)) <= 40


@given(st.lists(any_text, max_size=8))
@settings(deadline=None, max_examples=50)
def test_words_are_words_and_differ_in_more_than_capitals(names: list[str]) -> None:
    made = words(names, taken=("solid",))
    assert set(made) == set(names)
    assert all(re.fullmatch(r"[A-Za-z][A-Za-z0-9_]*", word) for word in made.values())
    assert all(len(word) <= 80 for word in made.values())
    assert len({word.lower() for word in made.values()} | {"solid"}) == len(made) + 1


def test_layers_keep_names_that_files_can_keep() -> None:
    good = ["core", "Ober-Schicht 2.1", "Kühlung", "銅", "a_b", "x" * 64, "S235+N"]
    assert [name for name in good if not is_label(name)] == []
    bad = [
        "",
        " a",
        "a ",
        "a  b",
        "1a",
        "u=0",
        "w (1)",
        "a/b",
        'a"',
        "a.",
        "x" * 65,
        "a\u0301\u202e",
    ]
    assert [name for name in bad if is_label(name)] == []
    harmless = [text for text in TEXTS if is_label(text)]
    assert len(harmless) == 6
    assert all(set(text) < set(ascii_letters + "0123456789 ._") for text in harmless)
    assert [x for x in TEXTS if is_identifier(x)] == ["end_header", "solid", "CON"]
    u, v, w = (pc_parameter(name) for name in "uvw")
    equation = point_equation((u, v, w))
    with pytest.raises(LayersError, match="a letter, then"):
        equation.layered(["a", "b\n*STEP"])


@pytest.mark.parametrize(
    "name", ["", "..", ".", "a/b", "../a", "a\\b", "a\0b", "a\n", "-rf", "nul", "COM1.step", "a.",
             " a", "x" * 256, "é" * 128, "a:b", "*", "\u202ea"],
)  # fmt: skip
def test_names_of_our_own_files_stay_in_their_folder(name: str) -> None:
    with pytest.raises(NameNotAllowedError, match="cannot be the name of a file"):
        check_file_name(name)
    assert check_file_name("0f3a.step") == "0f3a.step"


SLOTS: Mapping[str, str] = {
    "parameter": '[parameters]\n{0} = 1',
    "point": "[points]\n{0} = [0, 0, 0]",
    "layer": "[layers]\n{0} = 1\nb = 1",
    "let": '[let]\n{0} = 1',
    "curve": '[curves.{0}]\nkind = "ellipse"\na = 1\nb = 1',
    "table": "[{0}]\na = 1",
    "unit": "units = {0}",
}  # fmt: skip
SOLID = '\n[solid]\nx = "u"\ny = "v"\nz = "w"\n'


def toml(text: str) -> str:
    """Return a text as a basic string of TOML, which has no halves of pairs."""
    whole = text.encode("utf-8", "replace").decode()
    return json.dumps(whole, ensure_ascii=False).replace("\x7f", "\\u007f")


@pytest.mark.parametrize("slot", SLOTS)
def test_hostile_names_are_refused_in_every_slot(slot: str) -> None:
    allowed = is_label if slot == "layer" else is_identifier
    hostile = [text for text in TEXTS if not allowed(text) and (slot != "unit" or clean(text))]
    assert len(hostile) > 35
    for text in hostile:
        more = SLOTS[slot].format(toml(text))
        text = f'title = "t"\n{more}{SOLID}'
        with pytest.raises(InputError):
            parse_template(text, "t")


def test_names_of_bodies_are_identifiers() -> None:
    body = "[[bodies]]\nname = {}\n[bodies.solid]\nx = 'u'\ny = 'v'\nz = 'w'\n"
    for text in TEXTS:
        with pytest.raises(InputError):
            parse_template(
                f"title = 't'\nresult = 'union(a, b)'\n{body.format(toml(text))}"
                + body.format('"b"'), "t",
            )  # fmt: skip


@given(any_text)
@settings(deadline=None, max_examples=40)
def test_free_texts_and_file_names_are_printable_when_read(text: str) -> None:
    head = "\n".join(f"{key} = {toml(text or 'x')}" for key in ("about", "source"))
    template = parse_template(f"title = {toml('T' + text)}\n{head}{SOLID}", text)
    equation = template.bind({})
    told = [equation.name, equation.title, equation.source, *equation.about.split("\n")]  # type: ignore[union-attr]
    assert [one for one in told if not one.isprintable()] == []
    assert equation.name


# -- terminals -------------------------------------------------------------------------------------

SHOWING = """\
title = {0}
about = {0}
source = {0}
[parameters]
p = {{ default = 1, about = {0} }}
[points]
A = [0, 0, 0]
[curves.c]
kind = "polar"
r = "1 +\\r\\n\\t 0*phi"
[let]
q = "p +\\r\\n\\t 1"
[solid]
x = "u *\\r q"
y = "v"
z = "w"
"""


@pytest.mark.parametrize("verb", [["show"], ["show", "--latex"], ["check"]])
def test_nothing_of_a_template_reaches_a_terminal_raw(
    verb: list[str], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    lines = []
    hostile = "".join(TEXTS[:12]).replace("/", "")
    name = f"t{hostile[:60]}.toml".replace("\0", "")
    for text, file in (("plain", "t.toml"), (hostile, name)):
        (tmp_path / file).write_text(SHOWING.format(toml(text)))
        assert main([verb[0], str(tmp_path / file), *verb[1:]]) == 0
        out, err = capsys.readouterr()
        assert err == ""
        lines.append(out.split("\n"))
    assert [line for line in lines[1] if not line.isprintable()] == []
    more = sum(line.count("\n") for line in hostile.splitlines(keepends=True)[1:])
    assert len(lines[1]) <= len(lines[0]) + len(hostile.splitlines()) - 1 + 0 * more


COMMANDS = [
        ["build", "{0}", "-o", "{0}.step"], ["build", "pyramid", "-o", "{0}"], ["{0}"],
        ["build", "pyramid", "-o", "no/{0}.step"], ["check", "pyramid", "-s", "{0}=1"],
        ["check", "pyramid_cut", "-s", "p={0}"], ["check", "pyramid", "--body", "{0}"],
        ["new", "no/{0}.toml"], ["study", "pyramid_cut", "--vary", "{0}=1", "-o", "o"],
        ["study", "pyramid_cut", "--vary", "p={0}", "-o", "o"],
        ["study", "pyramid_cut", "--vary", "p=.5", "--formats", "{0}", "-o", "o"],
        ["study", "pyramid_cut", "--vary", "p=.5", "--plot", "{0}:p", "-o", "o"],
        ["study", "pyramid_cut", "--table", "{0}.csv", "-o", "o"],
        ["render", "pyramid", "-o", "{0}"], ["mesh", "pyramid", "-o", "{0}"],
        ["spline", "pyramid", "-o", "{0}"], ["points", "pyramid", "-o", "{0}"],
        ["view", "pyramid", "-o", "{0}"],
    ]  # fmt: skip


@pytest.mark.parametrize("command", COMMANDS, ids=" ".join)
def test_errors_are_one_printable_sentence(
    command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("PC2CAD_DEBUG", "0")
    # what means something there is no mistake
    mistakes = [x for x in TEXTS if x not in ("-2+3", "+1", "../../evil", "TextureFile x.png")]
    for text in mistakes[COMMANDS.index(command) % 6 :: 6]:
        assert main([part.replace("{0}", text) for part in command]) in (2, 5)
        out, err = capsys.readouterr()
        assert out == ""
        assert err.endswith("\n")
        assert err[:-1].isprintable()
        assert "unexpected" not in err
    assert [path.name for path in tmp_path.rglob("*") if path.name != "o"] == []


def test_tracebacks_are_printable_too(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PC2CAD_DEBUG", "1")
    assert main(["show", "a\x1b[2J\rb"]) == 2
    err = capsys.readouterr().err
    assert "Traceback" in err
    assert [line for line in err.split("\n") if not line.isprintable()] == []


# -- writers ---------------------------------------------------------------------------------------


def step_name(data: bytes) -> str:
    from steputils import p21

    assert p21.loads(data.decode("ascii")).data
    (found,) = re.findall(r"PRODUCT\('((?:[^']|'')*)',", data.decode("ascii"))
    return re.sub(
        r"''|\\\\|\\X([24]?)\\(?:([0-9A-F]{2})(?![0-9A-F])|([0-9A-F]+)\\X0\\)", meant, found
    )


def meant(found: re.Match[str]) -> str:
    """Return what a directive of ISO 10303-21 means; other readers do not decode all of them."""
    if found[0] in ("''", "\\\\"):
        return found[0][0]
    raw = bytes.fromhex(found[2] or found[3])
    return raw.decode({"": "latin-1", "2": "utf-16-be", "4": "utf-32-be"}[found[1]])


def iges_name(data: bytes) -> str:
    """Return the product's name of the global section, whose strings begin with their length."""
    text = "".join(line[:72] for line in data.decode("ascii").splitlines() if line[72:73] == "G")
    fields = []
    while len(fields) < 4:
        if found := re.match(r"(\d+)H", text):
            end = found.end() + int(found[1])
            fields.append(text[found.end() : end])
        else:
            end = re.search(r"[,;]", text).start()  # type: ignore[union-attr]
            fields.append(text[:end])
        text = text[end + 1 :]
    return unquote(fields[2])


def stl_name(data: bytes) -> str:
    read = trimesh.load(io.BytesIO(data), file_type="stl")
    assert read.is_watertight
    return unquote(data[:80].decode("ascii").partition("unit mm: ")[2].rstrip(" \0"))


def stl_text_name(data: bytes) -> str:
    read = trimesh.load(io.BytesIO(data), file_type="stl")
    assert len(read.faces) == 12
    return unquote(str(read.metadata["name"]).removesuffix(" unit mm"))


def threemf_name(data: bytes) -> str:
    core = "{http://schemas.microsoft.com/3dmanufacturing/core/2015/02}"
    with zipfile.ZipFile(io.BytesIO(data)) as package:
        root = ElementTree.fromstring(package.read("3D/3dmodel.model"))
    titles = [m.text for m in root.iter(f"{core}metadata") if m.get("name") == "Title"]
    assert root.find(f".//{core}object").get("name") == titles[0]  # type: ignore[union-attr]
    return str(titles[0])


def glb_name(data: bytes) -> str:
    (length,) = struct.unpack("<I", data[12:16])
    return str(json.loads(data[20 : 20 + length])["nodes"][0]["name"])


def nothing(data: bytes) -> None:
    assert data


NAMES_BACK: Mapping[str, Callable[[bytes], str | None]] = {
    "step": step_name, "brep": nothing, "iges": iges_name, "stl": stl_name,
    "stl text": stl_text_name, "3mf": threemf_name, "glb": glb_name, "vtp": nothing,
}  # fmt: skip
#: what the kernel writes and reads back takes a tenth of a second, whatever it is called
FEW = ("".join(TEXTS[3:9]), "Größe ∫ 👩 '') ;\\X2\\", "endsolid vertex 1 COLOR=", "3Hole")


@pytest.mark.parametrize("kind", FORMATS, ids=lambda kind: kind.name)
@pytest.mark.parametrize("names", [FEW, pytest.param(TEXTS, marks=pytest.mark.slow)])
def test_solids_give_their_names_back(kind: Any, names: Any, exportable: Exportable) -> None:
    limit = {"stl": 20, "iges": 60}.get(kind.name, 200)
    assert names
    for text in names:
        named = replace(exportable, name=clean(text) or "unnamed")
        data = format_for(f"a{kind.extensions[0]}").encoder()(named, ExportOptions())
        back = NAMES_BACK[kind.name](data)
        if back is not None and back != named.name:
            assert len(percent(named.name, "", limit=10**6)) > limit, "only long names are cut"
            assert len(back) > 1
            assert named.name.startswith(back.rstrip("…\ufffd"))


def heading(path: Path) -> str:
    assert len(meshio.read(path).points) == 12
    lines = path.read_text("ascii").split("\n")
    assert [line for line in lines if line.startswith("*")][:2] == ["*HEADING", "*NODE, NSET=solid"]
    return unquote(lines[1].removesuffix(" (mm)"))


def vtk_title(path: Path) -> str:
    reader = vtk.vtkUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    assert reader.GetOutput().GetNumberOfPoints() == 12
    return unquote(reader.GetHeader().removesuffix(" (mm)"))


def med_title(path: Path) -> str:
    with h5py.File(path) as file:
        return unquote(file["ENS_MAA/mesh"].attrs["DES"].decode())


def read_only(path: Path) -> None:
    assert len(meshio.read(path).points) == 12


TITLES = {".inp": heading, ".vtk": vtk_title, ".med": med_title, ".vtu": read_only,
          ".msh": read_only}  # fmt: skip


@pytest.mark.parametrize("ending", [entry.extension for entry in MESH_FORMATS])
def test_meshes_give_the_parts_name_back(ending: str, mesh: VolumeMesh, tmp_path: Path) -> None:
    path = tmp_path / f"a{ending}"

    @given(any_text)
    @example("*INCLUDE, INPUT=evil.inp, X=")
    @settings(deadline=None, max_examples=15)
    def check(text: str) -> None:
        name = clean(text)
        write_mesh(replace(mesh, name=name), path)
        back = TITLES[ending](path)
        assert back is None or back == name or name.startswith(back.rstrip("\ufffd"))

    check()


def sets_of_meshio(path: Path) -> set[str]:
    read = meshio.read(path)
    return {*read.field_data, *read.cell_sets, *getattr(read, "cell_tags", {})}


def groups_of_med(path: Path) -> set[str]:
    with h5py.File(path) as file:
        names = [
            bytes(row).rstrip(b"\0").decode()
            for family in file["FAS/mesh/ELEME"].values() for row in family["GRO/NOM"][...]
        ]  # fmt: skip
    return set(map(unquote, names))


def names_of_vtu(path: Path) -> set[str]:
    reader = vtk.vtkXMLUnstructuredGridReader()
    reader.SetFileName(str(path))
    reader.Update()
    data = reader.GetOutput().GetFieldData()
    return {data.GetArrayName(i) for i in range(data.GetNumberOfArrays())}


def names_of_msh(path: Path) -> set[str]:
    return {unquote(name) for name in meshio.read(path).field_data}


def names_of_inp(path: Path) -> set[str]:
    return {*re.findall(r"^\*ELSET, ELSET=(\w+)$", path.read_text(), re.MULTILINE)}


SETS = {".vtu": names_of_vtu, ".msh": names_of_msh, ".med": groups_of_med, ".inp": names_of_inp}


@pytest.mark.parametrize("ending", SETS)
def test_layers_are_found_by_their_names(ending: str, mesh: VolumeMesh, tmp_path: Path) -> None:
    names = ["core", "Ober-Schicht 2.1", "Kühlung", "銅", "Core", "solid", "S235+N"]
    parts = list(mesh.layers.values())
    for first, second in pairwise(names):
        write_mesh(replace(mesh, layers=dict(zip((first, second), parts, strict=True))),
                   tmp_path / f"a{ending}")  # fmt: skip
        wanted = {first, second}
        if ending == ".inp":
            wanted = set(words([*mesh.node_sets, *mesh.sides, first, second], ("solid",)).values())
            wanted -= set(words([*mesh.node_sets, *mesh.sides], ("solid",)).values())
            assert len({name.lower() for name in wanted} | {"solid"}) == 3
        assert wanted <= SETS[ending](tmp_path / f"a{ending}")


def test_what_is_cut_stays_apart() -> None:
    start = "a" * 90
    found = told_apart([f"{start}{k}" for k in range(12)] + [start[:80]], 80)
    assert len(set(found.values())) == len(found) == 13
    assert all(len(text) <= 80 for text in found.values())
    assert told_apart(["u=0", "Größe"], 80) == {"u=0": "u=0", "Größe": "Gr%C3%B6%C3%9Fe"}


def groups_of_nodes(path: Path) -> dict[str, list[int]]:
    with h5py.File(path) as file:
        names = {
            int(family.attrs["NUM"]): [
                bytes(row).rstrip(b"\0").decode() for row in family["GRO/NOM"][...]
            ]
            for family in file["FAS/mesh/NOEUD"].values()
        }
        (step,) = file["ENS_MAA/mesh"].values()
        families = step["NOE/FAM"][...].tolist()
    found: dict[str, list[int]] = {}
    for node, family in enumerate(families):
        for name in names.get(family, ()):
            found.setdefault(name, []).append(node)
    return found


def test_any_number_of_sets_are_groups_of_nodes(mesh: VolumeMesh, tmp_path: Path) -> None:
    """A family stands for the sets that a node is in: 64 bits do not hold those of many bodies."""
    random = np.random.default_rng(5)
    few = mesh.node_sets
    many = {f"s{k}": np.sort(random.permutation(len(mesh.points))[:9]) for k in range(100)}
    for sets in (few, many):
        write_mesh(replace(mesh, node_sets=sets), tmp_path / "a.med")
        wanted = {name: nodes.tolist() for name, nodes in sets.items() if name not in mesh.pieces}
        assert groups_of_nodes(tmp_path / "a.med") == wanted


@pytest.mark.parametrize("ending", [entry.extension for entry in MESH_FORMATS])
def test_writers_escape_names_that_no_template_can_have(
    ending: str, mesh: VolumeMesh, tmp_path: Path
) -> None:
    parts = list(mesh.layers.values())
    path = tmp_path / f"a{ending}"
    for text in TEXTS[:: 1 if ending != ".med" else 5]:  # 100 ms each
        write_mesh(replace(mesh, layers=dict(zip((f"n{text}", "b"), parts, strict=True))), path)
        if ending != ".vtk":
            assert len(meshio.read(path).points) == 12
        if ending == ".inp":
            assert "INCLUDE" not in re.findall(r"^\*(\w+)", path.read_text(), re.MULTILINE)


@pytest.mark.interop
@pytest.mark.skipif(shutil.which("ccx") is None, reason="CalculiX is not installed")
def test_calculix_obeys_no_name(mesh: VolumeMesh, tmp_path: Path) -> None:
    (tmp_path / "evil.inp").write_text("*HEADING\nobeyed\n*NODE, NSET=evil\n99, 0, 0, 0\n")
    rest = (
        "*MATERIAL, NAME=m\n*ELASTIC\n1, 0.3\n*SOLID SECTION, ELSET=solid, MATERIAL=m\n*STEP\n"
        "*STATIC\n*BOUNDARY\nw_0, 1, 3\n*NODE PRINT, NSET=w_1\nU\n*END STEP\n"
    )
    for text in (
        "*INCLUDE, INPUT=evil.inp, X=",
        "a\r*INCLUDE,INPUT=evil.inp",
        " * INCLUDE, INPUT=evil.inp",
    ):
        write_mesh(replace(mesh, name=clean(text)), tmp_path / "a.inp")
        with open(tmp_path / "a.inp", "a") as stream:
            stream.write(rest)
        done = subprocess.run(
            ["ccx", "a"], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
        )
        assert "Job finished" in done.stdout
        assert "*INFO" not in done.stdout or "evil" not in done.stdout
        assert "evil" not in (tmp_path / "a.dat").read_text().lower()
        assert not re.search(r"^\s*99\s", (tmp_path / "a.frd").read_text(), re.MULTILINE)


def ply_name(path: Path) -> str:
    assert trimesh.load(path).vertices.shape == (5, 3)
    assert meshio.read(path).points.shape == (5, 3)
    comments = [x for x in path.read_bytes().split(b"\n") if x.startswith(b"comment")]
    return unquote(comments[0].decode("ascii").removeprefix("comment ").removesuffix(" (mm)"))


def test_point_files_are_read_whatever_the_part_is_called(
    layered: PointEquation, tmp_path: Path
) -> None:
    points = sample_uniform(check_map(layered), 5, 0)
    for text in TEXTS:
        name = clean(text)
        named: PointSet = replace(points, name=name)
        for ending, encode in POINT_FORMATS.items():
            (tmp_path / f"a{ending}").write_bytes(encode(named))
        assert name.startswith(ply_name(tmp_path / "a.ply").rstrip("\ufffd"))
        with np.load(tmp_path / "a.npz") as arrays:
            assert arrays["points"].shape == (5, 3)
        reader = vtk.vtkXMLPolyDataReader()
        reader.SetFileName(str(tmp_path / "a.vtp"))
        reader.Update()
        assert reader.GetOutput().GetNumberOfPoints() == 5


def test_spline_files_hold_nothing_of_names(layered: PointEquation, tmp_path: Path) -> None:
    plain, hostile = (
        spline_equation(replace(layered, name=name, layers=()))[0] for name in ("a", "<b>\n" * 9)
    )
    assert len(SPLINE_FORMATS) == 4
    for entry in SPLINE_FORMATS:
        files = [tmp_path / f"{k}{entry.extension}" for k in range(2)]
        for model, path in zip((plain, hostile), files, strict=True):
            write_splines(model, path)
        assert files[0].read_bytes() == files[1].read_bytes()
    ElementTree.parse(tmp_path / "1.xml")


class Titles(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.stack: list[str] = []
        self.tags: list[str] = []
        self.texts: dict[str, str] = {}

    def handle_starttag(self, tag: str, attrs: Any) -> None:
        self.stack.append(tag)
        self.tags.append(tag)

    def handle_endtag(self, tag: str) -> None:
        while self.stack and self.stack.pop() != tag:
            pass

    def handle_data(self, data: str) -> None:
        if self.stack:
            self.texts[self.stack[-1]] = self.texts.get(self.stack[-1], "") + data


def test_pages_pictures_reports_and_tables_give_texts_back() -> None:
    tags = None
    for text in TEXTS:
        title = clean(text)
        slider = Slider("p", title, 1.0, (1.0,))
        reader = Titles()
        reader.feed(page(title, [slider], [Variant(None, title)], live=False).decode())
        tags = tags or reader.tags
        assert reader.tags == tags
        assert reader.texts.get("title", "") == title
        state = next(
            json.loads(x)
            for x in script_texts(page(title, [slider], [Variant(None, title)], live=False))
        )
        assert state["sliders"][0]["about"] == state["problems"]["0"] == title
        shape = Text(title, 1.0, 1.0, (0.0, 0.0, 0.0))
        root = ElementTree.fromstring(svg(np.zeros((2, 2, 3), np.uint8), [], [shape]))
        assert (root.findall("{http://www.w3.org/2000/svg}text")[-1].text or "") == title
        (header, row) = csv.reader(io.StringIO(to_csv([{text: text, "b": -1.5}]).decode()))
        assert header[0] == row[0] == cell(text)
        assert row[0].removeprefix("'") == title.removeprefix("'")
        assert row[1] == "-1.5"


def script_texts(data: bytes) -> list[str]:
    return re.findall(rb'<script type="application/json" id="state">(.*?)</script>', data, re.S)  # type: ignore[return-value]


def test_reasons_are_no_formulas_and_one_line() -> None:
    from pc2cad.studies.table import rows

    outcome = Outcome("k", "bad input", "=HYPERLINK(1)\n\x1b[2J")
    table = to_csv(rows(Plan(("p",), ((1.0,),)), ["k"], {"k": outcome}, ()))
    (row,) = csv.DictReader(io.StringIO(table.decode()))
    assert row["reason"] == "'=HYPERLINK(1) [2J"


def test_only_the_module_for_it_writes_to_terminals() -> None:
    package = Path(sys.modules["pc2cad"].__file__ or "").parent
    using = {
        path.relative_to(package).as_posix()
        for path in package.rglob("*.py")
        if re.search(r"sys\.(stdout|stderr)|traceback\.print|\bprint\(", path.read_text())
    }
    assert using == {"cli/output.py", "cli/main.py"}
    assert ".write(" not in (package / "cli/main.py").read_text()
    assert os.sep == "/"
