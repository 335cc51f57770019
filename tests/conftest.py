"""What all tests share."""

import os

import pytest
from hypothesis import HealthCheck, settings

# Machines differ in speed: a slow example is no failure.
settings.register_profile(
    "kaju", deadline=None, suppress_health_check=[HealthCheck.too_slow], derandomize=True
)
settings.load_profile("kaju")

_WANTING = ("not installed", "could not import", "No module named")


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_makereport(item, call):
    """Fail what would be skipped for want of a program, where all programs must be there."""
    outcome = yield
    report = outcome.get_result()
    if report.skipped and os.environ.get("KAJU_TESTS_NEED_ALL"):
        reason = str(report.longrepr)
        if any(words in reason for words in _WANTING):
            report.outcome = "failed"
            report.longrepr = f"may not be skipped here: {reason}"
