"""Set-up for all tests: kernels are compiled once; files without their libraries are skipped."""

import os
import subprocess
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import pytest

pytest_plugins = ["tests.helpers.browsers"]

LIBRARIES = {"duckdb", "fcl", "h5py", "nbformat", "pandas", "plyfile", "polars", "sybil", "yaml"}
"""Libraries of the extra `test`; files that import a missing one are skipped, but not in CI."""


def pytest_configure(config: pytest.Config) -> None:
    """Compile the kernels before the workers start, unless the installation has done so.

    Otherwise every worker, and every command started by a test, would compile the same kernels.
    """
    if not hasattr(config, "workerinput") and config.getoption("numprocesses", None):
        words = [sys.executable, "-m", "grasp3d._kernels.ahead"]
        if subprocess.run(words, stdout=subprocess.DEVNULL, check=False).returncode:
            raise pytest.UsageError("the kernels could not be compiled, see above")


class PassedOver(pytest.Module):
    """A file of tests that is skipped if one of the LIBRARIES is missing."""

    def collect(self) -> Iterable[pytest.Item | pytest.Collector]:
        try:
            return super().collect()
        except self.CollectError as error:
            missing = getattr(error.__cause__, "name", None)
            if missing not in LIBRARIES or os.environ.get("CI"):
                raise
            pytest.skip(f"needs {missing}, of the extra `test`", allow_module_level=True)


def pytest_pycollect_makemodule(module_path: Path, parent: pytest.Collector) -> PassedOver:
    return PassedOver.from_parent(parent, path=module_path)


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: Any) -> Any:
    """Give each worker half of the files, and an idle worker tests of the other one.

    By default workers take the tests of a file in turns, and both create what its tests need.
    """
    if config.getoption("dist") != "load":  # another mode was requested
        return None
    from xdist.scheduler import WorkStealingScheduling

    return WorkStealingScheduling(config, log)


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """Print how many examples of the documentation ran, and why others did not."""
    reports = [one for kind in ("passed", "failed") for one in terminalreporter.getreports(kind)]
    properties = [pair for report in reports for pair in getattr(report, "user_properties", ())]
    blocks = sum(value for name, value in properties if name == "blocks")
    skipped = Counter(why for name, value in properties if name == "skipped" for why in value)
    if blocks or skipped:
        reasons = "".join(f"\n  {count} skipped: {why}" for why, count in skipped.most_common())
        terminalreporter.write_line(f"{blocks} examples of the documentation ran{reasons}")
