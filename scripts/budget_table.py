"""Table of the documentation: what each uncertainty costs on the shipped meshes.

For each mesh and one finger: parts of the friction angle of the best grasp at each vertex, their
medians over the area where there is a grasp, the uncertainty that takes the most, and the area
fractions that are S with all uncertainties, and with the sensor resolution alone. The finger has a
round tip of 20 mm diameter, a receptive field of 4 mm, encoders of 12 bits at two joints, 60 mm and
30 mm from the contact, and a friction of 0.4 to 0.6. The search knows these uncertainties, and
openings are limited to 80 mm.

    python scripts/budget_table.py [MESH ...]
"""

import argparse
import math
import sys
from collections import Counter
from collections.abc import Iterable
from pathlib import Path

import numpy as np

import grasp3d
from grasp3d.contact import JointEncoders, MarginBudget
from grasp3d.contact.budget import MARGIN
from grasp3d.surface.area_statistics import quantiles, vertex_weights

ROOT = Path(__file__).parents[1]

SENSOR = grasp3d.Sensor(receptive_field=0.004, fingertip_radius=0.01)
JOINTS = JointEncoders(counts=4096, lengths=(0.06, 0.03))
FRICTION = (0.4, 0.6)
OPENING = 0.08
"""Lengths in metres."""

COLUMNS = ("critical angle", "location", "encoders", MARGIN)
"""Columns of the table; what friction and sensor resolution cost is the same everywhere."""

SHOWN = ("critical angle", "friction", "sensor resolution", "location", "encoders", MARGIN)


def budget_of(labels: grasp3d.SurfaceLabels) -> MarginBudget:
    """Return the budget of the best grasp at each vertex."""
    found = np.isfinite(labels.critical_angle)
    return MarginBudget.of(
        labels.critical_angle,
        friction=FRICTION,
        sensor=SENSOR,
        encoders=JOINTS,
        opening=np.where(found, labels.opening, math.inf),
    )


def labels_of(path: Path, model: grasp3d.GraspModel) -> grasp3d.SurfaceLabels:
    """Label a mesh, those without a unit in metres."""
    mesh = grasp3d.load_mesh(path)
    if mesh.unit is None:
        mesh = grasp3d.load_mesh(path, unit="m")
    return grasp3d.label_surface(mesh, model, sampling=grasp3d.Sampling(max_opening=OPENING))


def row_of(path: Path) -> tuple[str, str]:
    """Return the row of a mesh as Markdown, and the uncertainty that costs the most."""
    uncertainty = SENSOR.uncertainty + JOINTS.uncertainty
    labels = labels_of(path, grasp3d.GraspModel(friction=FRICTION).with_uncertainty(uncertainty))
    budget, area = budget_of(labels), vertex_weights(labels.mesh, "area")
    used = np.where(np.isfinite(labels.critical_angle), area, 0.0)
    medians = {name: quantiles(budget.stack[name], [0.5], used)[0] for name in SHOWN}
    costs = {name: medians[name] for name in SHOWN[1:-1]}
    costliest = max(costs, key=costs.__getitem__)
    cells = [f"{math.degrees(medians[name]):.1f}" for name in COLUMNS]
    stable = 100.0 * area[budget.margin > 0.0].sum()
    paper = labels_of(path, grasp3d.GraspModel(sensor_resolution=SENSOR.resolution))
    cells += [costliest, f"{stable:.0f}", f"{100.0 * paper.fractions()['S']:.0f}"]
    return f"| {' | '.join([path.name, *cells])} |", costliest


def table(paths: Iterable[Path]) -> str:
    """Return the table as Markdown."""
    heads = ["mesh", "β\\*", *COLUMNS[1:], "costs the most", "S", "S, normals only"]
    lines = [f"| {' | '.join(heads)} |", "|---|---:|---:|---:|---:|---|---:|---:|"]
    found: Counter[str] = Counter()
    for path in paths:
        row, costliest = row_of(path)
        lines.append(row)
        found[costliest] += 1
    lines.append("")
    lines.append("; ".join(f"{name}: {count}" for name, count in found.most_common()))
    return "\n".join(lines)


def shipped_meshes() -> list[Path]:
    """Return the files of the shipped meshes, one of each."""
    known = {".glb", ".obj", ".off", ".ply", ".stl", ".3mf"}
    return sorted(path for path in (ROOT / "meshes").iterdir() if path.suffix in known)


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("meshes", nargs="*", type=Path)
    given = parser.parse_args().meshes
    sys.stdout.write(table(given or shipped_meshes()) + "\n")


if __name__ == "__main__":
    main()
