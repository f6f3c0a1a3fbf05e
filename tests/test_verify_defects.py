"""Files of the kernel with one thing wrong in their text are refused, in words that name it."""

from __future__ import annotations

import re
from collections.abc import Callable
from math import pi
from pathlib import Path

import cadquery as cq
import pytest
from consumers.samples import SplineSolid, write_step, write_with_properties
from consumers.step_edits import edit, instance, move, pole, read_instances, without_face
from consumers.step_file import check_step

from pc2cad.verify.defects import StepDefectError, StepUnreadableError

#: of the sound solids
VOLUMES = {
    "box": 10 * 20 * 30,
    "cylinder": pi * 5**2 * 12,
    "sphere": 4 / 3 * pi * 5**3,
    "torus": 2 * pi**2 * 10 * 3**2,
    "hollow": 4 / 3 * pi * (5**3 - 3**3),
    "drilled": 10**3 - pi * 1.5**2 * 10,
    "spline": SplineSolid().volume(),
}


@pytest.fixture(scope="module")
def texts(tmp_path_factory: pytest.TempPathFactory) -> dict[str, str]:
    """The text of sound files, one instance a line."""
    folder = tmp_path_factory.mktemp("sound")
    sphere = cq.Workplane().sphere(5.0)
    shapes = {
        "box": cq.Solid.makeBox(10.0, 20.0, 30.0),
        "cylinder": cq.Solid.makeCylinder(5.0, 12.0),
        "sphere": sphere.val(),
        "torus": cq.Solid.makeTorus(10.0, 3.0),
        "hollow": sphere.cut(cq.Workplane().sphere(3.0)).val(),
        "drilled": cq.Workplane().box(10.0, 10.0, 10.0).faces(">Z").hole(3.0).val(),
        "spline": SplineSolid().solid(),
    }
    paths = {name: write_step(shape, folder / f"{name}.step") for name, shape in shapes.items()}
    paths["stated"] = write_with_properties(shapes["box"], folder / "stated.step", 6000.1)
    return {name: read_instances(path) for name, path in paths.items()}


def _flip(text: str, keyword: str, number: int = 0) -> str:
    """Turn the last logical flag of an instance round."""
    found = instance(text, keyword, number)
    old = found.group(3)[-3:]
    return edit(text, found, old, {".T.": ".F.", ".F.": ".T."}[old])


def _flip_on(text: str, carrier: str) -> str:
    """Turn the same_sense of the first face on a surface of this kind round."""
    surfaces = {found.group(1) for found in re.finditer(rf"(#\d+) = {carrier}\(", text)}
    faces = list(re.finditer(r"(#\d+) = (ADVANCED_FACE)\((.*?)\);", text))
    number = next(i for i, f in enumerate(faces) if f.group(3).split(",")[-2] in surfaces)
    return _flip(text, "ADVANCED_FACE", number)


def _curve_pole(text: str) -> str:
    found = instance(text, "B_SPLINE_CURVE_WITH_KNOTS")
    poles = re.search(r"\((#[#\d,]*)\)", found.group(3))
    assert poles
    return poles.group(1).split(",")[2]


def _move_plane(text: str) -> str:
    plane = instance(text, "PLANE").group(3).split(",")[-1]
    placement = re.search(rf"{plane} = AXIS2_PLACEMENT_3D\('',(#\d+)", text)
    assert placement
    return move(text, placement.group(1))


def _inside_out(text: str) -> str:
    """Turn every face and every wire round: consistent, but the volume is negative."""
    swap = {".T.": ".F.", ".F.": ".T."}
    pattern = r"(#\d+ = (?:ADVANCED_FACE|FACE_BOUND)\([^;]*)(\.[TF]\.)\);"
    return re.sub(pattern, lambda found: f"{found[1]}{swap[found[2]]});", text)


def _one_shell(text: str) -> str:
    """Put the face of the void into the outer shell."""
    outer, void = (instance(text, "CLOSED_SHELL", number).group(3) for number in (0, 1))
    joined = outer.replace("))", ")").rstrip(")") + "," + void.partition("(")[2]
    return text.replace(outer, joined, 1)


Edit = Callable[[str], str]
CONTROLS: dict[str, tuple[str, Edit, str]] = {
    "pole on a side": (
        "spline",
        lambda t: move(t, pole(t, 0, 2)),
        "leaves the surface of the face",
    ),
    "corner pole": ("spline", lambda t: move(t, pole(t, 0, 0)), "leaves the surface of the face"),
    "pole of an edge": (
        "spline",
        lambda t: move(t, _curve_pole(t)),
        "leaves the surface of the face",
    ),
    "vertex": (
        "spline",
        lambda t: move(t, instance(t, "VERTEX_POINT").group(3).split(",")[-1]),
        "misses its vertex",
    ),
    "flipped plane": ("box", lambda t: _flip(t, "ADVANCED_FACE"), "is turned over"),
    "flipped plane with a hole": ("drilled", lambda t: _flip_on(t, "PLANE"), "is turned over"),
    "flipped spline": ("spline", lambda t: _flip(t, "ADVANCED_FACE", 2), "is turned over"),
    "flipped full cylinder": (
        "cylinder",
        lambda t: _flip_on(t, "CYLINDRICAL_SURFACE"),
        "theorem of Stokes fails",
    ),
    "flipped sphere": ("sphere", lambda t: _flip(t, "ADVANCED_FACE"), "inside out"),
    "flipped torus": ("torus", lambda t: _flip(t, "ADVANCED_FACE"), "inside out"),
    "flipped void": ("hollow", lambda t: _flip(t, "ORIENTED_CLOSED_SHELL"), "the void"),
    "flipped edge": ("box", lambda t: _flip(t, "ORIENTED_EDGE", 5), "is not closed"),
    "flipped closed edge": (
        "cylinder",
        lambda t: _flip(t, "ORIENTED_EDGE", -1),
        "is not consistently oriented",
    ),
    "flipped seam": ("torus", lambda t: _flip(t, "ORIENTED_EDGE"), "not consistently oriented"),
    "flipped curve": ("box", lambda t: _flip(t, "EDGE_CURVE"), "does not run from its start"),
    "flipped circle": (
        "cylinder",
        lambda t: _flip(t, "EDGE_CURVE"),
        "is turned over|theorem of Stokes fails",
    ),
    "flipped wire": ("box", lambda t: _flip(t, "FACE_BOUND"), "not consistently oriented"),
    "all flipped": ("box", _inside_out, "inside out"),
    "face removed": ("box", without_face, "is open"),
    "spline face removed": ("spline", without_face, "is open"),
    "void without own shell": ("hollow", _one_shell, "unconnected pieces"),
    "plane moved": ("box", _move_plane, "leaves the plane of the face"),
    "radius": (
        "cylinder",
        lambda t: edit(t, instance(t, "CYLINDRICAL_SURFACE"), ",5.", ",5.01"),
        "leaves the surface of the face",
    ),
    "dangling reference": (
        "box",
        lambda t: t.replace(instance(t, "VERTEX_POINT").group(0), "", 1),
        "does not contain",
    ),
    "broken text": ("box", lambda t: t[: t.rindex(";", 0, len(t) // 2)], "ends too early"),
    "stated volume": ("stated", lambda t: t, "states the volume 6000.1"),
}


@pytest.mark.parametrize("name", list(CONTROLS))
def test_one_wrong_thing_is_refused(name: str, texts: dict[str, str], tmp_path: Path) -> None:
    source, edit, sentence = CONTROLS[name]
    path = tmp_path / "wrong.step"
    path.write_text(edit(texts[source]))
    with pytest.raises((StepDefectError, StepUnreadableError), match=sentence):
        check_step(path)


def test_the_texts_themselves_are_sound(texts: dict[str, str], tmp_path: Path) -> None:
    path = tmp_path / "sound.step"
    assert texts.keys() == VOLUMES.keys() | {"stated"}
    for name, volume in VOLUMES.items():
        path.write_text(texts[name])
        assert check_step(path).volume == pytest.approx(volume, rel=1e-9), name


def test_pole_inside_a_face_shows_in_the_volume_only(texts: dict[str, str], tmp_path: Path) -> None:
    """No border sees it: the volume must be compared with what is known of the solid."""
    path = tmp_path / "moved.step"
    path.write_text(move(texts["spline"], pole(texts["spline"], 2, 2)))
    moved = check_step(path)
    assert moved.max_stokes_residual < 1e-12
    assert abs(moved.volume - SplineSolid().volume()) > 1e-3
