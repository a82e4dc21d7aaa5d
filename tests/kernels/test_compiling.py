import json
import os
import re
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numba
import pytest

from grasp3d import Contacts, critical_friction_angle
from grasp3d._kernels import compiling

CALLEE = """
from small.compiling import kernel, merged, part

@kernel()
def called(x):
    return x + {step}

@merged
def merged_in(x):
    return x + 10 * {step}

@part
def linked(x, power):
    return x + 100 * {step} + power
"""

CALLER = """
from small.callee import called, linked, merged_in
from small.compiling import kernel

@kernel()
def climb(x):
    return linked(merged_in(called(x)) + called(0) - called(0), 0)
"""

REPORT = """
import json
from small.callee import called, linked, merged_in
from small.caller import climb
from small.compiling import code_folders
print(json.dumps({
    "value": climb(0),
    "signatures": [len(kernel.signatures) for kernel in (called, linked, merged_in)],
    "hits": sum(climb.stats.cache_hits.values()),
    "folders": list(map(str, code_folders())),
}))
"""


@dataclass
class Package:
    """Two small kernels, one calling the other, with the decorators, in their own folder."""

    home: Path

    @property
    def folder(self) -> Path:
        return self.home / "small"

    def write(self, step: int) -> None:
        (self.folder / "callee.py").write_text(CALLEE.format(step=step), encoding="utf-8")

    def run(self, **variables: str) -> dict[str, Any]:
        """Call the kernels in a fresh interpreter whose home folder is the package's."""
        inherited = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "XDG_"))}
        env = {
            **inherited,
            "PYTHONPATH": str(self.home),
            # Python's own byte code would miss a change within the same second.
            "PYTHONDONTWRITEBYTECODE": "1",
            "XDG_CACHE_HOME": str(self.home / "cache"),
            **variables,
        }
        process = subprocess.run(
            [sys.executable, "-W", "error", "-c", REPORT],
            capture_output=True,
            text=True,
            env=env,
            check=False,
        )
        assert process.returncode == 0, process.stderr
        return {**json.loads(process.stdout), "said": process.stderr}

    def block(self) -> None:
        """Prevent a cache folder beside the sources, even for an administrator."""
        (self.folder / "__pycache__").write_text("not a folder")


@pytest.fixture
def package(tmp_path: Path) -> Package:
    made = Package(tmp_path)
    made.folder.mkdir()
    (made.folder / "__init__.py").touch()
    (made.folder / "caller.py").write_text(CALLER, encoding="utf-8")
    shutil.copy2(str(compiling.__file__), made.folder)
    made.write(step=1)
    return made


def files(folder: Path) -> dict[Path, int]:
    """Modification time of each file of compiled kernels."""
    return {path: path.stat().st_mtime_ns for path in folder.rglob("*.nbc")}


@pytest.mark.slow
def test_machine_code_is_compiled_once_for_each_version_of_the_sources(
    package: Package, tmp_path: Path
) -> None:
    """Also in copies, as installations are; a change in one file recompiles its callers."""
    first = package.run()
    assert (first["value"], first["hits"]) == (111, 0)
    # One line tells the user why it takes long.
    (line,) = first["said"].splitlines()
    assert re.fullmatch(r"grasp3d: compiling, once for .*", line)
    # Parts are compiled into kernels only; a constant in a call has the type of a variable.
    assert first["signatures"] == [1, 1, 1]
    stored = files(package.folder / "__pycache__")
    assert {path.name.split("-")[0] for path in stored} == {"caller.climb", "callee.called"}
    copy = Package(tmp_path / "elsewhere")
    shutil.copytree(package.folder, copy.folder)
    carried = files(copy.home)
    for again in (package.run(), copy.run()):
        assert (again["value"], again["hits"], again["said"]) == (111, 1, "")
    assert files(package.folder) == stored
    assert files(copy.home) == carried  # read in place
    old = Path(first["folders"][0])
    os.utime(old, (0.0, 0.0))
    package.write(step=2)
    changed = package.run()
    assert (changed["value"], changed["hits"]) == (222, 0)
    assert not old.exists()


DAMAGES: tuple[Callable[[bytes], bytes], ...] = (
    lambda _: b"",
    lambda data: data[: len(data) // 2],
    lambda data: data[9:],
)
"""As after a full disk, a crash, and an error of the disk."""


@pytest.mark.parametrize("damage", DAMAGES)
def test_damaged_machine_code_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, damage: Callable[[bytes], bytes]
) -> None:
    monkeypatch.setattr(compiling, "code_folders", lambda: (tmp_path,))

    def tripled(x: float) -> float:
        return 3.0 * x

    assert compiling.kernel()(tripled)(1.5) == 4.5
    (path,) = files(tmp_path)
    sound = path.read_bytes()
    path.write_bytes(damage(sound))
    again = compiling.kernel()(tripled)
    assert again(1.5) == 4.5
    assert (sum(again.stats.cache_hits.values()), list(files(tmp_path))) == (0, [path])
    later = compiling.kernel()(tripled)
    assert later(1.5) == 4.5
    assert sum(later.stats.cache_hits.values()) == 1


@pytest.mark.slow
def test_each_processor_has_its_machine_code(package: Package) -> None:
    for hits in (0, 1):
        for processor in ("", "generic"):
            report = package.run(NUMBA_CPU_NAME=processor)
            assert (report["value"], report["hits"]) == (111, hits)


def test_a_part_is_a_kernel_where_python_calls_it() -> None:
    @compiling.merged
    def square_of_sum(a: float, b: float) -> float:
        return (a + b) * (a + b)

    @compiling.kernel()
    def one_more(a: float, b: float) -> float:
        return 1.0 + square_of_sum(a, b)

    assert (square_of_sum(1.0, 2.0), one_more(1.0, 2.0)) == (9.0, 10.0)
    assert square_of_sum.kernel.signatures == square_of_sum.signatures


@pytest.mark.slow
def test_machine_code_is_kept_beside_a_package_that_cannot_be_written(package: Package) -> None:
    """First where NUMBA_CACHE_DIR names a folder, then in the user's cache; both are read."""
    package.block()
    chosen, user = package.home / "chosen", package.home / "cache" / "grasp3d"
    report = package.run(NUMBA_CACHE_DIR=str(chosen))
    assert report["hits"] == 0
    assert [Path(folder).parent for folder in report["folders"][1:]] == [chosen, user]
    assert files(chosen) == files(package.home) != {}
    assert package.run()["hits"] == 0
    assert files(user)
    shutil.rmtree(chosen)
    stored = files(package.home)
    assert package.run(NUMBA_CACHE_DIR=str(chosen))["hits"] == 1
    assert files(package.home) == stored


@pytest.mark.slow
def test_kernels_run_where_no_machine_code_can_be_written(package: Package) -> None:
    package.block()
    report = package.run(XDG_CACHE_HOME=str(package.folder / "caller.py" / "below"))
    assert report["value"] == 111
    assert "for this process only: no folder can be written" in report["said"]
    assert "NUMBA_CACHE_DIR" in report["said"]
    assert not files(package.home)


@pytest.mark.slow
def test_a_user_without_a_home_folder(package: Package) -> None:
    assert package.run(XDG_CACHE_HOME="", HOME="~")["value"] == 111  # "~": no home folder


def test_machine_code_that_can_only_be_read_is_read_and_completed_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """An administrator may write everywhere, so writing is refused here."""
    folders = brought, written = tmp_path / "brought", tmp_path / "written"
    monkeypatch.setattr(compiling, "code_folders", lambda: folders)

    def doubled(x: float) -> float:
        return 2.0 * x

    assert compiling.kernel()(doubled)(1.5) == 3.0
    before = files(tmp_path)
    assert {path.parent for path in before} == {brought}

    def refuse(folder: Path) -> None:
        if folder == brought:
            raise PermissionError
        folder.mkdir()

    monkeypatch.setattr(compiling, "make_folder", refuse)
    again = compiling.kernel()(doubled)
    assert again(1.5) == 3.0
    assert sum(again.stats.cache_hits.values()) == 1
    assert files(tmp_path) == before
    assert again(3) == 6  # for integers it is compiled
    assert {path.parent for path in files(tmp_path)} == {brought, written}


def test_functions_without_a_module_are_compiled_beside_kernels() -> None:
    namespace: dict[str, Any] = {}
    exec("def twice(x):\n    return 2 * x", {"__name__": None}, namespace)  # noqa: S102
    twice = namespace["twice"]
    assert twice.__module__ is None
    critical_friction_angle(
        Contacts([[1, 0, 0], [-1, 0, 0]], [[-1, 0, 0], [1, 0, 0]], friction=0.5)
    )
    assert numba.njit(twice)(21) == 42
