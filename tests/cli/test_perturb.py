"""`grasp3d perturb`."""

import re
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import label_surface, load_mesh
from grasp3d.system.tables import read_columns
from tests.helpers import shapes
from tests.helpers.commands import printed
from tests.helpers.commands import run_here as grasp3d

QUICK = ("--copies", "3", "--max-edge", "9cm", "--unit", "cm", "--rays", "16")


@pytest.fixture
def scan(tmp_path: Path) -> Path:
    """A ball of 8 cm with errors of 0.2 mm."""
    points, faces = shapes.sphere(3, radius=4.0)
    errors = np.random.default_rng(0).normal(0.0, 0.005, len(points))
    path = tmp_path / "scan.ply"
    trimesh.Trimesh(points * (1.0 + errors)[:, None], faces, process=False).export(path)
    return path


@pytest.mark.slow
def test_it_prints_what_to_enter_and_writes_the_results(scan: Path) -> None:
    text = printed("perturb", scan.name, "--noise", "0.2mm", *QUICK, cwd=scan.parent)
    noise = "noise of each of the 3 copies: 0.2 mm along the normals (as given), independent at"
    assert noise in text
    assert re.search(r"over 95 % of the area and copies, normals turn by at most \d", text)
    entered = re.search(r"enter: --normal-error (\S+) --location-error (\S+)mm", text)
    assert entered
    assert 1.0 < float(entered[1]) < 30.0
    assert 0.0 < float(entered[2]) < 0.2
    assert (scan.parent / "scan_noise.ply").exists()
    again = grasp3d("perturb", scan.name, "--noise", "0.2mm", *QUICK, cwd=scan.parent)
    assert again.stdout == text  # it replaces its own results


@pytest.mark.slow
def test_what_it_prints_can_be_entered(scan: Path) -> None:
    done = grasp3d("perturb", scan.name, *QUICK, "-o", "a.csv", cwd=scan.parent)
    assert "estimated from the surface's roughness" in done.stdout
    words = re.search(r"enter: (.+)", done.stdout)
    assert words
    text = printed(
        "label", scan.name, "--unit", "cm", "--max-edge", "9cm", "--rays", "16",
        *words[1].split(), "-o", "b.ply", cwd=scan.parent,
    )  # fmt: skip
    fraction = re.search(r"with these errors (\S+) % of the area is S", done.stdout)
    assert fraction
    stable = re.search(r"S    surely stable +(\S+) %", text)
    assert stable
    assert float(stable[1]) == pytest.approx(float(fraction[1]), abs=0.3)
    rows = read_columns(scan.parent / "a.csv")
    assert len(rows["stable"]) == len(load_mesh(scan, unit="cm", max_edge=9.0).vertices)


@pytest.mark.slow
def test_where_noise_is_too_strong_the_cure_is_named(scan: Path) -> None:
    done = grasp3d("perturb", scan.name, "--noise", "5mm", *QUICK, "-q", cwd=scan.parent)
    assert (done.returncode, done.stdout) == (0, "")
    done = grasp3d("perturb", scan.name, "--noise", "5mm", *QUICK, cwd=scan.parent)
    assert "no errors to enter" in done.stdout
    assert "over a patch of a few edge lengths (--patch-radius)" in done.stdout
    patch = ("--patch-radius", "4mm", "--correlation", "0.5mm")
    done = grasp3d("perturb", scan.name, "--noise", "7mm", *QUICK, *patch, cwd=scan.parent)
    assert "no errors to enter" in done.stdout
    assert "over a patch larger than 4 mm (--patch-radius)" in done.stdout
    assert "alike within 0.5 mm" in done.stdout


def test_the_model_is_stated_and_its_normal_error_contained(scan: Path) -> None:
    words = ("--friction", "0.4..0.6", "--normal-error", "2", "--noise", "0.2mm")
    done = grasp3d("perturb", scan.name, *words, *QUICK, cwd=scan.parent)
    assert "friction 0.4 to 0.6, sensor resolution 22.6°, normals ± 2°" in done.stdout
    assert "with these errors (they contain the 2° given) " in done.stdout
    entered = re.search(r"enter: --normal-error (\S+)", done.stdout)
    assert entered
    assert float(entered[1]) > 3.0


@pytest.mark.parametrize("option", ["--location-error", "--per-finger", "--method"])
def test_what_noisy_copies_do_not_take_is_no_option(tmp_path: Path, option: str) -> None:
    text = grasp3d("perturb", "--help-all", cwd=tmp_path).stdout
    assert option not in re.findall(r"--[a-z-]+", text)


@pytest.mark.slow
def test_the_figure_shows_the_surface(scan: Path) -> None:
    from PIL import Image

    text = printed(
        "perturb", scan.name, "--noise", "0.2mm", *QUICK, "--figure", "a.png", cwd=scan.parent
    )
    assert text.rstrip().endswith("a.png")
    with Image.open(scan.parent / "a.png") as image:
        pixels = np.asarray(image.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(pixels, axis=0)) > 500
    labels = label_surface(load_mesh(scan, unit="cm", max_edge=9.0))
    assert labels.fractions()["S"] > 0.9
