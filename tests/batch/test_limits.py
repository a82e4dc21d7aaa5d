from pathlib import Path

import psutil
import pytest

from grasp3d.batch import limits
from grasp3d.batch.limits import machine_memory

MACHINE = psutil.virtual_memory().total / 1e9


@pytest.fixture
def groups(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder in place of the control groups of Linux."""
    monkeypatch.setattr(limits, "_CONTROL_GROUPS", tmp_path)
    (tmp_path / "memory").mkdir()
    return tmp_path


def test_without_a_container_it_is_that_of_the_machine(groups: Path) -> None:
    assert machine_memory() == MACHINE
    (groups / "memory.max").write_text("max\n", encoding="ascii")
    assert machine_memory() == MACHINE
    (groups / "memory.high").write_text(f"{10**18}\n", encoding="ascii")
    assert machine_memory() == MACHINE
    (groups / "memory.max").write_text("0\n", encoding="ascii")
    assert machine_memory() == MACHINE


@pytest.mark.parametrize("name", ["memory.max", "memory.high", "memory/memory.limit_in_bytes"])
def test_a_container_may_allow_less(groups: Path, name: str) -> None:
    (groups / name).write_text("123000000\n", encoding="ascii")
    assert machine_memory() == 0.123
