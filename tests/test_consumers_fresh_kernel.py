"""A new process with the kernel reads what was written."""

from __future__ import annotations

from math import pi
from pathlib import Path

import cadquery as cq
import pytest
from consumers.fresh_kernel import read_in_fresh_process
from consumers.samples import SplineSolid, write_step
from consumers.step_file import check_step


def test_hollow_sphere_in_inches(tmp_path: Path) -> None:
    shape = cq.Workplane().sphere(5.0).cut(cq.Workplane().sphere(3.0)).val()
    found = read_in_fresh_process(write_step(shape, tmp_path / "hollow.step", unit="INCH"))
    assert (found["shape_type"], found["valid"]) == ("SOLID", True)
    assert (found["solids"], found["shells"], found["faces"]) == (1, 2, 2)
    assert found["free_edges"] == 0
    assert found["volume"] == pytest.approx(392.0 / 3.0 * pi, rel=1e-11)
    assert found["area"] == pytest.approx(136.0 * pi, rel=1e-11)
    assert found["centroid"] == pytest.approx([0.0, 0.0, 0.0], abs=1e-10)


def test_spline_solid_agrees_with_the_kernel_free_check(tmp_path: Path) -> None:
    path = write_step(SplineSolid().solid(), tmp_path / "spline.step")
    own, found = check_step(path), read_in_fresh_process(path, precise=True)
    assert (found["faces"], found["edges"], found["vertices"]) == (6, 12, 8)
    assert found["volume"] == pytest.approx(own.volume, rel=1e-12)
    assert found["area"] == pytest.approx(own.area, rel=1e-9)
    assert found["centroid"] == pytest.approx(own.centroid, rel=1e-11)
    assert max(found[f"max_{kind}_tolerance"] for kind in ("vertex", "edge", "face")) < 1e-6


def test_open_shell_has_free_edges(tmp_path: Path) -> None:
    box = cq.Solid.makeBox(10.0, 20.0, 30.0)
    shell = cq.Shell.makeShell(box.Faces()[:5])
    found = read_in_fresh_process(write_step(shell, tmp_path / "open.step"))
    assert (found["shape_type"], found["solids"], found["free_edges"]) == ("SHELL", 0, 4)


def test_unreadable_file_is_reported(tmp_path: Path) -> None:
    path = tmp_path / "nonsense.step"
    path.write_text("nonsense")
    with pytest.raises(RuntimeError, match="cannot read"):
        read_in_fresh_process(path)
