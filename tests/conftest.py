"""Which tests are slow, what each one takes, and that CI skips none.

slow.txt lists the tests that take more than half a second of CPU by themselves, beside those that
say so with a mark. ``pytest --cpu=FOLDER`` writes what each takes, with its children, in seconds.
In CI (which `.ci/run` says by CI=true) no test may be skipped for want of a program.
"""

from __future__ import annotations

import os
import signal
import sys
from collections.abc import Generator
from pathlib import Path

import pytest

from pc2cad.templates.shipped import bodies_paths, template_paths
from pc2cad.trust.processes import collect_rarely

HERE = Path(__file__).parent
#: what may be missing in CI: words of the reason to skip -> why it cannot be installed there
MAY_BE_MISSING: dict[str, str] = {}

# The hundred processes that tests start read one cache of bytecode, as users' do
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)
collect_rarely()  # as the command does

Report = pytest.TestReport | pytest.CollectReport


def strict(report: Report) -> Report:
    """Fail what was skipped, unless its reason is on the list."""
    if os.environ.get("CI") and report.skipped and not hasattr(report, "wasxfail"):
        reason = str(report.longrepr[-1] if isinstance(report.longrepr, tuple) else report.longrepr)
        if not any(words in reason for words in MAY_BE_MISSING):
            report.outcome = "failed"
            report.longrepr = f"{report.nodeid} may not be skipped in CI: {reason}"
    return report


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, Report]:
    return strict((yield))


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_make_collect_report() -> Generator[None, pytest.CollectReport, Report]:
    return strict((yield))


# -- slow tests ------------------------------------------------------------------------------------


#: ids of the list that no test of the collected files has
GONE = pytest.StashKey[list[str]]()


def listed() -> list[str]:
    """Return the ids of the tests that are slow though they bear no mark."""
    return (HERE / "slow.txt").read_text(encoding="utf-8").splitlines()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    slow = set(listed())
    for item in items:
        if item.nodeid in slow:
            item.add_marker(pytest.mark.slow)
    if not any("::" in argument for argument in config.args):
        collected = {item.nodeid for item in items}
        files = {name.split("::")[0] for name in collected}
        gone = {name for name in slow - collected if name.split("::")[0] in files}
        config.stash[GONE] = sorted(gone)


@pytest.hookimpl(specname="pytest_collection_modifyitems", trylast=True)
def together(items: list[pytest.Item]) -> None:
    """Put tests of one shipped template one after the other: most processes compile it once."""
    templates = template_paths() | bodies_paths()

    def template(item: pytest.Item) -> str:
        given = (
            item.callspec.params.values()
            if isinstance(item, pytest.Function) and hasattr(item, "callspec")
            else ()
        )
        named = (getattr(x, "template", x.stem if isinstance(x, Path) else x) for x in given)
        return next((x for x in named if isinstance(x, str) and x in templates), "~")

    items.sort(key=template)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption("--cpu", metavar="FOLDER", help="write each test's seconds of CPU there")


def spent() -> float:
    return sum(os.times()[:4])


@pytest.hookimpl(wrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator[None, object, object]:
    begun = spent()
    result = yield
    # a test's own gmsh lets a closed pipe end the process
    signal.signal(signal.SIGPIPE, signal.getsignal(signal.SIGPIPE))
    if folder := item.config.getoption("--cpu"):
        name = os.environ.get("PYTEST_XDIST_WORKER", "main")
        with (Path(folder) / f"{name}.txt").open("a", encoding="utf-8") as file:
            file.write(f"{spent() - begun:.2f} {item.nodeid}\n")
    return result


@pytest.fixture
def gone(request: pytest.FixtureRequest) -> list[str]:
    return request.config.stash.get(GONE, [])
