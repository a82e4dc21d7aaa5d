"""Measure what noise of a scan does to labels, on meshes whose true surface is known.

    python scripts/noise_table.py [MESH ...] [--copies 30]

Each mesh is divided finely and taken as the true surface. A scan of it has errors along the
normals; `grasp3d.validating.perturbing` sees the scan only. Prints a Markdown table: the estimated
noise over the true one, the angle that 95 % of the scan's normals are within of the true ones, the
errors that are advised, and the fraction of what is S on the scan, without and with these errors,
whose grasp is S on the true surface.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np

from grasp3d import Label, MeshOptions, SurfaceLabels, label_surface, load_mesh
from grasp3d.arrays import angles_between
from grasp3d.mesh.noise import random_field
from grasp3d.mesh.noisy_copies import MovableSurface, movable_surface
from grasp3d.surface.area_statistics import quantiles, vertex_weights
from grasp3d.validating.perturbing import NoiseSettings, Perturbation, perturb_surface
from grasp3d.validating.perturbing.perturb import angles_on

LIBRARY = Path(__file__).parents[1] / "meshes"
SHOWN = ("banana.ply", "bulb.glb", "hammer.ply")
FINE = 40.0
"""Edges per size of an object."""
NOISE, PATCH, FILTERED = 0.1, 3.0, 2.0
"""Standard deviation of the noise, radius of the patch and correlation length, in mean edges."""
SEED = 99


def true_surface(path: Path, patch: float) -> MovableSurface:
    """A shipped mesh, divided finely; normals averaged over a patch of so many mean edges."""
    fine = load_mesh(path, unit="m", max_edge=load_mesh(path, unit="m").size / FINE)
    options = MeshOptions(unit="m", max_edge=fine.size)
    plain = movable_surface((fine.vertices, fine.faces), options)
    radius = patch * plain.mean_edge
    smooth = MeshOptions(unit="m", max_edge=fine.size, patch_radius=radius)
    return movable_surface((fine.vertices, fine.faces), smooth)


def right_fraction(body: MovableSurface, labels: SurfaceLabels) -> float:
    """Area fraction of what is S whose grasp is S on the true surface."""
    areas, stable = body.mesh.vertex_areas, labels.label == Label.S
    true = angles_on(body.mesh, labels) < labels.model.friction_angle - (
        labels.model.sensor_resolution / 2.0
    )
    area = float(areas[stable].sum())
    return float(areas[stable & true].sum()) / area if area else math.nan


def true_turn(body: MovableSurface, found: Perturbation) -> float:
    """Angle within which 95 % of the scan's normals are of the true ones [rad]."""
    angles = angles_between(body.mesh.normals, found.mesh.normals)
    return float(quantiles(angles, [0.95], vertex_weights(body.mesh, "area"))[0])


def row(path: Path, patch: float, correlation: float, copies: int) -> str:
    """One line of the table."""
    body = true_surface(path, patch)
    sigma, length = NOISE * body.mean_edge, correlation * body.mean_edge
    field = random_field(body.points, body.normals, length, np.random.default_rng(SEED))
    scan = body.moved(sigma * field[:, None] * body.normals)
    start = time.process_time()
    found = perturb_surface(
        (scan.vertices, scan.faces),
        noise=NoiseSettings(correlation=length, copies=copies),
        options=body.mesh.options,
    )
    seconds = (time.process_time() - start) / copies
    advice, estimated = found.advice, found.settings.noise or math.nan
    cells = [
        path.name, f"{len(body.points):,}", f"{1000.0 * sigma:.2f} mm", f"{correlation:g}",
        f"{patch:g}", f"{estimated / sigma:.2f}", f"{math.degrees(true_turn(body, found)):.1f}°",
    ]  # fmt: skip
    plain = f"{100.0 * found.labels.fractions()['S']:.0f} %"
    cells += [plain, f"{100.0 * right_fraction(body, found.labels):.1f} %"]
    if advice.stable_fraction > 0.01:
        labels = label_surface(found.mesh, found.model)
        cells += [
            f"{math.degrees(advice.normal_error):.1f}°, {1000.0 * advice.location_error:.2g} mm",
            f"{100.0 * advice.stable_fraction:.0f} %{'' if advice.passed else '*'}",
            f"{100.0 * right_fraction(body, labels):.1f} %",
        ]
    else:
        cells += ["none", "", ""]
    return "| " + " | ".join([*cells, f"{seconds:.1f} s"]) + " |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", default=SHOWN)
    parser.add_argument("--copies", type=int, default=30)
    options = parser.parse_args()
    heads = [
        "mesh", "vertices", "noise", "correlation", "patch", "estimated", "normals", "S", "right",
        "enter", "S then", "right then", "per copy",
    ]  # fmt: skip
    print("| " + " | ".join(heads) + " |")
    print("|" + "---|" * len(heads))
    for name in options.meshes:
        for patch, correlation in ((0.0, 0.0), (0.0, FILTERED), (PATCH, 0.0)):
            print(row(LIBRARY / name, patch, correlation, options.copies), flush=True)


if __name__ == "__main__":
    main()
