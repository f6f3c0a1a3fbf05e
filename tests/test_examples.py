"""The scripts of examples/: each gives figures and what they should be."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path
from shutil import which

import pytest

FOLDER = Path(__file__).parent.parent / "examples"
#: script -> how many figures it gives, and the largest relative error of any
ERRORS = {
    "bend_study": (6, 1e-12),
    "cadquery_duct": (4, 1e-8),
    "calculix_heat": (2, 2e-5),
    "draft_check": (3, 3e-4),
    "graded_block": (4, 1e-7),
    "jax_gradient": (3, 1e-6),
    "mfem_heat": (3, 5e-6),
    "openmdao_cone": (4, 1e-6),
    "stellarator": (3, 3e-4),
    "thickness_picture": (2, 2e-3),
}
#: script -> the program it needs, or the package
NEEDS = {
    "calculix_heat": "ccx", "jax_gradient": "jax", "mfem_heat": "mfem",
    "openmdao_cone": "openmdao.api",
}  # fmt: skip
#: what takes long, or comes with the packages of our users
ONCE = {"bend_study", "jax_gradient", "openmdao_cone"}
#: what is imported by others: the analyses have a test of their own
OTHERS = {"analyses", "solvers"}


def examples() -> list[object]:
    marks = {name: [pytest.mark.interop] for name in NEEDS}
    marks |= {name: [pytest.mark.slow] for name in ("bend_study", "stellarator")}
    return [pytest.param(name, marks=marks.get(name, [])) for name in ERRORS]


def need(name: str) -> None:
    if name == "calculix_heat":
        if which("ccx") is None:
            pytest.skip("CalculiX is not installed (apt-get install calculix-ccx)")
    elif name in NEEDS:
        pytest.importorskip(NEEDS[name])


def test_every_script_is_tried() -> None:
    assert {path.stem for path in FOLDER.glob("*.py")} == set(ERRORS) | OTHERS


@pytest.mark.parametrize("name", examples())
def test_an_example_finds_what_is_known(name: str) -> None:
    need(name)
    figures = import_module(name).main()
    count, most = ERRORS[name]
    assert len(figures) == count
    for figure, (found, exact) in figures.items():
        assert found == pytest.approx(exact, rel=most, abs=0), figure


@pytest.mark.slow
@pytest.mark.parametrize("name", [*(name for name in ERRORS if name not in ONCE), "analyses"])
def test_a_script_runs_by_itself(name: str, tmp_path: Path) -> None:
    need(name)
    done = subprocess.run(
        [sys.executable, FOLDER / f"{name}.py"],
        cwd=tmp_path, capture_output=True, text=True, timeout=300, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr[-2000:]
    assert done.stdout.count("exact") >= 1
