"""What `pip install .` leaves: an installed package whose kernels are compiled already."""

import json
import os
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from grasp3d._kernels.ahead import kernels

MESHES = Path(__file__).resolve().parents[1] / "meshes"

DESCRIBE = """
import json
from importlib.metadata import distribution
import grasp3d
found = distribution("grasp3d")
url = json.loads(found.read_text("direct_url.json") or "{}")
print(json.dumps([grasp3d.__path__[0], [str(file) for file in found.files or ()], url]))
"""

pytestmark = pytest.mark.slow


def in_installation(*words: str, home: Path) -> subprocess.CompletedProcess[str]:
    """Run Python where the checkout cannot be imported, with an empty home folder."""
    own = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "XDG_", "PYTHON"))}
    return subprocess.run(
        [sys.executable, *words], cwd=home, env={**own, "HOME": str(home)}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip


def machine_code(*folders: Path) -> dict[Path, int]:
    return {path: path.stat().st_mtime_ns for one in folders for path in one.rglob("*.nbc")}


@dataclass(frozen=True)
class Installed:
    """The installed package, seen from a folder without the checkout."""

    package: Path
    files: list[str]


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Installed:
    """The installed package, which is a copy of this checkout and not the checkout itself."""
    unusable = pytest.fail if os.environ.get("CI") == "true" else pytest.skip
    found = in_installation("-c", DESCRIBE, home=tmp_path_factory.mktemp("home"))
    if found.returncode:
        unusable("grasp3d is not installed")
    package, files, url = json.loads(found.stdout)
    if url.get("dir_info", {}).get("editable"):
        unusable("the installation is the checkout itself")
    return Installed(Path(package), files)


def test_an_installation_brings_machine_code(installed: Installed) -> None:
    names = {Path(file).name.partition("-")[0] for file in installed.files if ".nbc" in file}
    assert names >= kernels().keys()  # and that of kernels which these call


def test_an_installation_brings_every_file(installed: Installed) -> None:
    """Styles, pages and presets, which are no modules, too."""
    package = Path(__file__).resolve().parents[1] / "grasp3d"
    files = {path.relative_to(package) for path in package.rglob("*") if path.is_file()}
    wanted = {path for path in files if "__pycache__" not in path.parts}
    assert wanted
    assert not {str(path) for path in wanted if not (installed.package / path).is_file()}


def test_nothing_is_compiled_after_an_installation(installed: Installed, tmp_path: Path) -> None:
    before = machine_code(installed.package)
    main = ("-c", "import sys; from grasp3d.cli import main; sys.exit(main(sys.argv[1:]))")
    gripper = ("--hand", "franka", "--mass", "0.2kg", "--table", "as-is", "--best", "1")
    region = ("--region", "tee_labeled.ply", "-o", "part.ply")  # its colours are a mask, of all
    for options in ((), region, gripper):
        words = ("label", str(MESHES / "tee.glb"), *options, "--overwrite")
        done = in_installation(*main, *words, home=tmp_path)
        assert (done.returncode, "compiling" in done.stderr) == (0, False), done.stderr
    assert machine_code(installed.package, tmp_path) == before
