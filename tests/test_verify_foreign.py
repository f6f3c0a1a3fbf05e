"""Random valid files of CadQuery, build123d and FreeCAD: no false alarm, and gmsh agrees."""

from __future__ import annotations

import shutil
from importlib.util import find_spec
from pathlib import Path

import pytest

from benchmarks.foreign import MAKERS, disagreement, judge, make, second

pytestmark = [
    pytest.mark.interop,
    pytest.mark.skipif(
        find_spec("build123d") is None or not shutil.which("freecadcmd"),
        reason="build123d and FreeCAD are not both installed",
    ),
]


def test_a_dozen_files_of_other_programs_raise_no_alarm(tmp_path: Path) -> None:
    """`python -m benchmarks.foreign` makes as many as one likes; FreeCAD's 3 and 45 were alarms."""
    paths = make(tmp_path, 12, 1, list(MAKERS)) + make(tmp_path, 3, 43, list(MAKERS))
    assert len(paths) == 15
    found = {path: receipt for path, receipt, _ in judge(paths)}
    assert {path.name: receipt["defects"] for path, receipt in found.items()} == {
        path.name: [] for path in paths
    }
    assert [path.name for path, receipt in found.items() if receipt["sound"] is not True] == []
    wrong = {
        path.name: disagreement(receipt, other)
        for (path, receipt), other in zip(found.items(), second(paths), strict=True)
    }
    assert {name: words for name, words in wrong.items() if words} == {}
