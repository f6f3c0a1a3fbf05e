"""What strangers install: versions, licences and requirements are said the same everywhere."""

from __future__ import annotations

import re
import subprocess
import sys
import tomllib
from importlib.metadata import distribution
from importlib.util import find_spec
from pathlib import Path

import pytest

import pc2cad as pc

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]


def field(file: str, key: str) -> list[str]:
    """Return the values of a key in a YAML file of plain fields."""
    return re.findall(rf"^\s*{key}: (\S+)$", (ROOT / file).read_text(), re.MULTILINE)


def test_one_version() -> None:
    assert pc.__version__ == PROJECT["version"]
    assert field("CITATION.cff", "version") == [PROJECT["version"]]
    assert field("packaging/recipe.yaml", "version")[0] == PROJECT["version"]
    released = re.findall(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(), re.MULTILINE)
    assert PROJECT["version"] in released
    assert field("CITATION.cff", "date-released")[0] in (ROOT / "CHANGELOG.md").read_text()


def test_one_licence() -> None:
    assert PROJECT["license"] == "Apache-2.0"
    assert field("CITATION.cff", "license") == field("packaging/recipe.yaml", "license")
    assert field("CITATION.cff", "license") == ["Apache-2.0"]
    assert all((ROOT / name).is_file() for name in PROJECT["license-files"])
    assert "Apache License" in (ROOT / "LICENSE").read_text()
    marked = [
        path.name
        for path in (ROOT / "pc2cad").rglob("*.py")
        if "SPDX-License-Identifier" in path.read_text()
    ]
    assert marked == []


def test_the_recipe_asks_for_what_the_package_does() -> None:
    text = (ROOT / "packaging/recipe.yaml").read_text()
    run = re.search(r"\n  run:\n((?:    - .*\n)+)", text)
    assert run
    wanted = [line.removeprefix("    - ").replace(" ", "") for line in run[1].splitlines()]
    assert wanted == [f"python{PROJECT['requires-python']}", *PROJECT["dependencies"]]


def test_the_container_installs_the_libraries_that_the_readme_names() -> None:
    libraries = re.compile(r"\blib[a-z0-9-]+\b")
    readme = re.search(r"`apt-get install ([^`]+)`", (ROOT / "README.md").read_text())
    docker = re.search(r"apt-get install([^&]+)", (ROOT / "packaging/Dockerfile").read_text())
    assert readme
    assert docker
    assert libraries.findall(docker[1]) == libraries.findall(readme[1])


def test_types_are_shipped() -> None:
    assert (Path(pc.__file__).parent / "py.typed").is_file()
    assert "Typing :: Typed" in PROJECT["classifiers"]


def test_every_requirement_has_its_purpose_and_licence() -> None:
    page = (ROOT / "docs/licences.md").read_text()
    names = [re.match(r"[\w-]+", text)[0] for text in PROJECT["dependencies"]]
    assert len(names) == 6
    for name in names:
        assert page.count(f"\n| {name} | ") == 2
    assert "not stated" not in page


@pytest.mark.skipif(
    not find_spec("cadquery"), reason="licences are those of an installation with CadQuery"
)
def test_licences_are_those_of_the_installed_packages() -> None:
    command = [sys.executable, str(ROOT / "docs/make_licences.py"), "--names"]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    names = done.stdout.split()
    rows = re.findall(r"^\| ([\w-]+) \| ", (ROOT / "docs/licences.md").read_text(), re.MULTILINE)
    assert names == sorted(set(rows) - {"package"})
    assert {"cadquery", "numpy", "vtk"} <= set(names)
    assert not {"gmsh", "distributed"} & set(names)
    assert all(distribution(name) for name in names)


@pytest.mark.interop
@pytest.mark.skipif(not find_spec("rattler_build"), reason="needs py-rattler-build")
def test_the_conda_recipe_renders() -> None:
    from rattler_build import Stage0Recipe, VariantConfig

    recipe = Stage0Recipe.from_yaml((ROOT / "packaging/recipe.yaml").read_text())
    (rendered,) = recipe.render(VariantConfig())
    assert rendered.recipe.package.name == "pc2cad"
    assert str(rendered.recipe.package.version) == PROJECT["version"]
