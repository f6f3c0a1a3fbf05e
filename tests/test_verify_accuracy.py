"""Integrals of STEP files: what they are said to be off by holds, and says which it is."""

from __future__ import annotations

from math import pi, sqrt
from pathlib import Path

import cadquery as cq
import pytest
from consumers.samples import AP214, write_step
from plain_step import box

from pc2cad.verify.receipt import describe, parse_step

R, H = 2.0, 3.0
#: solid, its volume, area and the height of its centroid; areas None where they have a root
SOLIDS = {
    "box": (cq.Workplane().box(1, 2, 3).val(), 6.0, 22.0, 0.0),
    "far": (cq.Workplane(origin=(1e4, 0, 0)).box(1, 2, 3).val(), 6.0, 22.0, 0.0),
    "cylinder": (cq.Solid.makeCylinder(R, H), pi * R**2 * H, 2 * pi * R * (R + H), H / 2),
    "half": (
        cq.Solid.makeCylinder(R, H, angleDegrees=180), pi * R**2 * H / 2,
        pi * R * (R + H) + 2 * R * H, H / 2,
    ),
    "cone": (
        cq.Solid.makeCone(R, 0, H), pi * R**2 * H / 3, pi * R * (R + sqrt(R**2 + H**2)), H / 4,
    ),
    "ball": (cq.Solid.makeSphere(R, angleDegrees1=-90), 4 * pi * R**3 / 3, 4 * pi * R**2, 0.0),
    "torus": (cq.Solid.makeTorus(H, 1), 2 * pi**2 * H, 4 * pi**2 * H, 0.0),
    "parabola": (
        cq.Workplane().moveTo(0, 0).lineTo(1, 0).bezier([(1, 0), (0.5, 1), (0, 0)]).close()
        .extrude(H).val(), H / 3, None, H / 2,
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", SOLIDS)
def test_bounds_hold_what_is_known(name: str, tmp_path: Path) -> None:
    shape, volume, area, height = SOLIDS[name]
    path = write_step(shape, tmp_path / "solid.step", schema=AP214)
    (found,) = describe(parse_step(Path(path).read_bytes()))["solids"]
    assert found["volume_is"] == found["centroid_is"] == "bounded"
    assert abs(found["volume"] - volume) <= found["volume_error"] * volume < 1e-7 * volume
    assert abs(found["centroid"][2] - height) <= found["centroid_error"] < 1e-4
    assert found["area_is"] == ("sampled" if area is None else "bounded")
    if area is not None:
        assert abs(found["area"] - area) <= found["area_error"] * area < 1e-7 * area


def test_edges_off_their_plane_widen_the_bound() -> None:
    exact, loose = (
        describe(parse_step(text.encode()))["solids"][0]
        for text in (box(), box().replace("(1.0,2.0,3.0)", "(1.0,2.0,3.0000002)"))
    )
    assert exact["volume_error"] < 1e-11
    assert loose["volume_is"] == "bounded"
    assert abs(loose["volume"] - 6.0) <= 6.0 * loose["volume_error"]
    assert 1e-8 < loose["volume_error"] < 1e-5


def test_trimmed_balls_are_sampled(tmp_path: Path) -> None:
    cut = cq.Workplane().sphere(2).cut(cq.Workplane().cylinder(9, 0.5).translate((0.6, 0, 0)))
    path = write_step(cut.val(), tmp_path / "cut.step", schema=AP214)
    (found,) = describe(parse_step(Path(path).read_bytes()))["solids"]
    assert found["volume_is"] == found["area_is"] == "sampled"
    assert found["volume"] == pytest.approx(cut.val().Volume(), rel=1e-6)
