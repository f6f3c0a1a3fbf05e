"""The pinned versions that CI installs: one for every dependency, within the ranges we state."""

from __future__ import annotations

import tomllib
from pathlib import Path

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent


def test_every_dependency_is_pinned_within_its_range() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    texts = list(project["dependencies"])
    for extra in project["optional-dependencies"].values():
        texts += extra
    lines = (ROOT / "constraints.txt").read_text().splitlines()
    pins = dict(line.split("==") for line in lines if not line.startswith("#"))
    for wanted in map(Requirement, texts):
        name = canonicalize_name(wanted.name)
        if name != "pc2cad":
            assert wanted.specifier.contains(pins[name]), f"{wanted}: {pins[name]}"
    assert "-c constraints.txt" in (ROOT / ".ci" / "run").read_text()
