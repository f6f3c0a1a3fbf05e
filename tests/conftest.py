"""In CI (which `.ci/run` says by CI=true) no test may be skipped for want of a program."""

from __future__ import annotations

import os
import sys
from collections.abc import Generator

import pytest

#: what may be missing in CI: words of the reason to skip -> why it cannot be installed there
MAY_BE_MISSING: dict[str, str] = {}

# The hundred processes that tests start read one cache of bytecode, as users' do
sys.dont_write_bytecode = False
os.environ.pop("PYTHONDONTWRITEBYTECODE", None)

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
