"""What CI installs: pins with hashes within the ranges we state; what it may not skip."""

from __future__ import annotations

import re
import tomllib
from pathlib import Path

import pytest
from conftest import strict
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

ROOT = Path(__file__).parent.parent
RUN = (ROOT / ".ci" / "run").read_text()


def pins() -> dict[str, str]:
    """Return what is pinned, each checked to be one version with hashes and nothing else."""
    text = "".join((ROOT / "constraints.txt").read_text().split("\\\n"))
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    found = {}
    for line in lines:
        pin, *hashes = re.split(r" +--hash=", line)
        assert hashes, line
        assert all(re.fullmatch("sha256:[0-9a-f]{64}", each) for each in hashes), pin
        wanted = Requirement(pin)
        (only,) = wanted.specifier
        assert (only.operator, wanted.url) == ("==", None), pin
        found[canonicalize_name(wanted.name)] = only.version
    assert len(found) == len(lines), "a package is pinned twice"
    return found


def test_every_dependency_is_pinned_within_its_range_and_by_hashes() -> None:
    settings = tomllib.loads((ROOT / "pyproject.toml").read_text())
    project = settings["project"]
    texts = project["dependencies"] + settings["build-system"]["requires"]
    for extra in project["optional-dependencies"].values():
        texts += extra
    wanted = [each for each in map(Requirement, texts) if each.name != "pc2cad"]
    assert {each.name for each in wanted} > {"cadquery", "hatchling", "gmsh", "CQ-editor"}
    pinned = pins()
    for each in wanted:
        found = pinned[canonicalize_name(each.name)]
        assert each.specifier.contains(found), f"{each}: {found}"


def test_ci_installs_the_pins_and_nothing_else_and_runs_what_the_readme_says() -> None:
    commands = "".join(RUN.split("\\\n")).splitlines()
    asked = re.compile(r"\bpip\b.* (install|download|wheel) ")
    reaching = [line for line in commands if asked.search(line)]
    fetch = reaching.pop(0)
    assert "--require-hashes" in fetch
    assert "-r constraints.txt" in fetch
    # the others see only what was fetched, or ask for hashes again
    after = RUN[RUN.index("-r constraints.txt") :]
    assert after.index("PIP_NO_INDEX=1 PIP_FIND_LINKS=") < after.index("pip install")
    again = [line for line in reaching if "-u PIP_NO_INDEX" in line]
    assert len(again) == RUN.count("-u PIP_NO_INDEX") == 2
    assert all("--require-hashes --only-binary :all: -r" in line for line in again)
    assert len(reaching) == 8
    assert "|| echo" not in RUN.replace('[ -z "$current" ] || echo', "")
    # the two commands of the README, word for word
    assert "$(grep '^python3 -m venv' README.md)" in RUN
    install, test = re.findall(r"^python3 -m venv .*", (ROOT / "README.md").read_text(), re.M)
    assert "pip install -e . " in install
    assert test.endswith("pip install -e '.[test]' && .venv/bin/python -m pytest")
    assert 'pytest -m "slow and not interop"' in RUN
    assert "pytest -m interop" in RUN


@pytest.mark.parametrize("when", ["setup", "call"])
def test_a_test_skipped_in_ci_fails_unless_its_reason_is_listed(
    when: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    def skipped() -> pytest.TestReport:
        return pytest.TestReport(
            "a::b", ("a", 1, "b"), {}, "skipped", ("a", 1, "Skipped: no admesh"), when
        )

    monkeypatch.delenv("CI", raising=False)
    assert strict(skipped()).skipped
    monkeypatch.setenv("CI", "true")
    assert strict(skipped()).failed
    monkeypatch.setattr("conftest.MAY_BE_MISSING", {"no admesh": "no package for this system"})
    assert strict(skipped()).skipped
