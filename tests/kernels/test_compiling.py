import ast
import importlib
import inspect
import json
import os
import re
import shutil
import subprocess
import sys
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest
from numba.core.dispatcher import Dispatcher

import grasp3d
from grasp3d._kernels import ahead, compiling
from grasp3d._kernels.ahead import kernels, warmup
from grasp3d._kernels.compiling import code_folders, name_of
from grasp3d.errors import OutputError

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
        own = {
            "PYTHONPATH": str(self.home),
            # Python's own byte code would miss a change within the same second.
            "PYTHONDONTWRITEBYTECODE": "1",
            "XDG_CACHE_HOME": str(self.home / "cache"),
        }
        process = subprocess.run(
            [sys.executable, "-W", "error", "-c", REPORT], env=inherited | own | variables,
            capture_output=True, text=True, check=False,
        )  # fmt: skip
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


@pytest.mark.parametrize("kept", [slice(0), slice(100), slice(9, None)])
def test_damaged_machine_code_is_missing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, kept: slice
) -> None:
    """As after a full disk, a crash, and an error of the disk."""
    monkeypatch.setattr(compiling, "code_folders", lambda: (tmp_path,))

    def tripled(x: float) -> float:
        return 3.0 * x

    assert compiling.kernel()(tripled)(1.5) == 4.5
    (path,) = files(tmp_path)
    sound = path.read_bytes()
    path.write_bytes(sound[kept])
    again = compiling.kernel()(tripled)
    assert again(1.5) == 4.5
    assert (sum(again.stats.cache_hits.values()), list(files(tmp_path))) == (0, [path])
    later = compiling.kernel()(tripled)
    assert later(1.5) == 4.5
    assert sum(later.stats.cache_hits.values()) == 1


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
    assert not files(package.home)


PACKAGE = Path(grasp3d.__file__).parent
KERNELS = "grasp3d._kernels"

jitted = pytest.mark.skipif(bool(os.environ.get("NUMBA_DISABLE_JIT")), reason="nothing is compiled")


def names_of_kernels(source: Path) -> Iterator[tuple[str, str]]:
    """(module, name) of everything that a file takes from modules of kernels."""
    tree = ast.parse(source.read_text(encoding="utf-8"))
    modules = {}
    for node in ast.walk(tree):
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith(KERNELS):
            for name in node.names:
                yield str(node.module), name.name
                modules[name.asname or name.name] = f"{node.module}.{name.name}"
    for node in ast.walk(tree):
        if isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            yield modules.get(node.value.id, ""), node.attr


def called_kernels() -> Iterator[Any]:
    for source in PACKAGE.rglob("*.py"):
        if "_kernels" in source.parts:
            continue
        for module, name in names_of_kernels(source):
            try:
                found = getattr(importlib.import_module(module), name, None)
            except (ImportError, ValueError):  # a name that is no module
                continue
            if isinstance(found, Dispatcher):
                yield found


@pytest.mark.slow
@jitted
def test_every_kernel_that_python_calls_is_compiled_ahead() -> None:
    called = {name_of(kernel) for kernel in called_kernels()}
    assert "wrench_problem.epsilons" in called
    assert called == kernels().keys()
    for kernel, ways in kernels().values():
        count = len(inspect.signature(kernel.py_func).parameters)
        assert {len(way) for way in ways} == {count}, kernel


@jitted
def test_what_is_compiled_is_not_compiled_again(monkeypatch: pytest.MonkeyPatch) -> None:
    warmup()
    monkeypatch.setattr(subprocess, "Popen", None)
    warmup()


@pytest.fixture
def copied(tmp_path: Path) -> Path:
    """A copy of what compiles the kernels, with machine code for all but one of them."""
    warmup()
    for part in ("_kernels", "system"):
        shutil.copytree(PACKAGE / part, tmp_path / "grasp3d" / part)
    for source in PACKAGE.glob("*.py*"):
        shutil.copy2(source, tmp_path / "grasp3d")
    folder = tmp_path / code_folders()[0].relative_to(PACKAGE.parent)
    for file in folder.glob("antipodal_candidates.scan-*"):
        file.unlink()
    return tmp_path


def build(folder: Path) -> subprocess.CompletedProcess[str]:
    """Compile as a build does, with an empty folder for the user."""
    own = {"PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder / "user")}
    return subprocess.run(
        [sys.executable, "-m", ahead.__name__], cwd=folder, env=os.environ | own,
        capture_output=True, text=True, check=False,
    )  # fmt: skip


@jitted
@pytest.mark.slow
def test_what_is_missing_is_compiled_beside_the_rest(copied: Path) -> None:
    done = build(copied)
    assert done.returncode == 0, done.stderr
    assert done.stderr.count("compiling") == 1
    folder = Path(done.stdout.strip())
    assert folder.is_relative_to(copied)
    names = Counter(path.name.partition("-")[0] for path in folder.iterdir())
    for name, (_, ways) in kernels().items():  # some are called by others too
        assert names[name] >= len(ways)
    assert not (copied / "user").exists()
    again = build(copied)
    assert (again.stdout, again.stderr) == (done.stdout, "")


@jitted
def test_a_process_that_ends_early_is_reported(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(ahead, "is_compiled", lambda *_: False)
    monkeypatch.setattr(sys, "executable", shutil.which("false"))
    with pytest.raises(OutputError, match=r"kernels were not compiled: see the lines above"):
        warmup()
