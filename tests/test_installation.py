"""What `pip install .` leaves: an installed package whose kernels are compiled already."""

import json
import os
import subprocess
import sys
from collections.abc import Iterator
from importlib.metadata import Distribution, PackageNotFoundError, distribution
from pathlib import Path

import pytest

from grasp3d._kernels.compiling import ahead

MESHES = Path(__file__).resolve().parents[1] / "meshes"

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def installed() -> Distribution:
    """The installed package, which is a copy of this checkout and not the checkout itself."""
    unusable = pytest.fail if os.environ.get("CI") == "true" else pytest.skip
    try:
        found = distribution("grasp3d")
    except PackageNotFoundError:
        unusable("grasp3d is not installed")
    url = json.loads(found.read_text("direct_url.json") or "{}")
    if url.get("dir_info", {}).get("editable"):
        unusable("the installation is the checkout itself")
    return found


def in_installation(*words: str, home: Path) -> subprocess.CompletedProcess[str]:
    """Run Python where the checkout cannot be imported, with an empty home folder."""
    own = {k: v for k, v in os.environ.items() if not k.startswith(("NUMBA_", "XDG_", "PYTHON"))}
    return subprocess.run(
        [sys.executable, *words],
        cwd=home,
        env={**own, "HOME": str(home)},
        capture_output=True,
        text=True,
        check=False,
    )


def machine_code(*folders: Path) -> Iterator[tuple[Path, int]]:
    for folder in folders:
        for path in folder.rglob("*.nb?"):
            yield path, path.stat().st_mtime_ns


def test_an_installation_brings_machine_code(installed: Distribution) -> None:
    files = [str(file) for file in installed.files or () if file.suffix == ".nbi"]
    assert {Path(file).name.partition("-")[0] for file in files} == set(ahead.kernels())


def test_nothing_is_compiled_after_an_installation(installed: Distribution, tmp_path: Path) -> None:
    place = in_installation("-c", "import grasp3d; print(grasp3d.__path__[0])", home=tmp_path)
    package = Path(place.stdout.strip())
    assert package == Path(str(installed.locate_file("grasp3d")))
    before = dict(machine_code(package))
    main = ("-c", "import sys; from grasp3d.cli import main; sys.exit(main(sys.argv[1:]))")
    gripper = ("--hand", "franka", "--mass", "0.2kg", "--table", "as-is", "--best", "1")
    for options in ((), gripper):
        words = ("label", str(MESHES / "tee.glb"), *options, "--overwrite")
        done = in_installation(*main, *words, home=tmp_path)
        assert done.returncode == 0, done.stderr
        assert "compiling" not in done.stderr
    assert dict(machine_code(package, tmp_path)) == before
