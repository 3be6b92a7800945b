"""Where other people's readers are at hand, none is left out: a test that would be skipped fails."""

import os
from collections.abc import Generator

import pytest


@pytest.hookimpl(wrapper=True)
def pytest_runtest_makereport() -> Generator[None, pytest.TestReport, pytest.TestReport]:
    report = yield
    if report.skipped and "RPAUG_READERS" in os.environ:
        report.outcome = "failed"
        report.longrepr = f"skipped, though RPAUG_READERS is set: {report.longrepr}"
    return report
