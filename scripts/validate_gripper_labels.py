"""Check best grasps with a gripper: `python scripts/validate_gripper_labels.py MESH ...`.

Each mesh stands on a table as it is. Each pose of its best grasps is checked by python-fcl, without
anything of the search: the gripper moves straight to the pose in 200 steps, and closes in 200
steps, and must touch neither the object, beyond the compliance of its pads, nor the table.
Collisions must be 0, and a mesh that can be grasped must have an S grasp.
"""

import argparse
import math
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from grasp3d import GraspModel, Sampling, Table, best_grasps, label_surface, load_mesh
from grasp3d.errors import GraspError
from grasp3d.grasps.verdict import verdict_of
from grasp3d.hand.hand_files import read_hand
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from tests.helpers.moving_gripper import MovingGripper


def main() -> int:
    """Print rows for each mesh; 1 where a pose collides or a mesh has no S grasp."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", nargs="+", type=Path)
    parser.add_argument("--unit", default="m", help="of meshes that state none")
    parser.add_argument("--hand", default="franka", help="preset or file")
    parser.add_argument("--compliance", type=float, default=0.001, help="of the pads [m]")
    parser.add_argument("--friction", type=float, default=0.4)
    parser.add_argument("--resolution", type=float, default=15.0, help="of the sensor [degrees]")
    parser.add_argument("--within", type=float, default=180.0, help="of straight down [degrees]")
    parser.add_argument("--best", type=int, default=20)
    parser.add_argument("--pictures", type=Path, help="folder for a picture of each mesh")
    options = parser.parse_args()
    if options.pictures:
        options.pictures.mkdir(parents=True, exist_ok=True)
    failed = 0
    for path in options.meshes:
        begun = time.process_time()
        labels = _labels(path, options)
        grasps = best_grasps(labels, options.best)
        seconds = time.process_time() - begun
        met = _collisions(grasps)
        failed += bool(any(met) or not (grasps.label == Label.S).any())
        fractions = ", ".join(
            f"{name} {100 * part:.1f} %" for name, part in labels.fractions().items()
        )
        print(f"{path.name}: {fractions}; {seconds:.0f} s of processor time")
        print(f"  {verdict_of(labels)}")
        _print_grasps(grasps, met)
        if options.pictures and grasps.size:
            _draw(labels, grasps, options.pictures / f"{path.stem}.png")
    return int(failed > 0)


def _labels(path: Path, options: argparse.Namespace) -> SurfaceLabels:
    from grasp3d.hand.table import Approach

    try:
        mesh = load_mesh(path)
    except GraspError:
        raise SystemExit(f"{path} cannot be read") from None
    if mesh.unit is None:
        mesh = load_mesh(path, unit=options.unit)
    return label_surface(
        mesh,
        GraspModel(friction=options.friction, sensor_resolution=math.radians(options.resolution)),
        sampling=Sampling(),
        hand=replace(read_hand(options.hand), compliance=options.compliance),
        table=Table.below(mesh),
        approach=Approach(within=math.radians(options.within)),
    )


def _collisions(grasps: GraspTable) -> list[str]:
    """What the gripper meets on its way to each grasp; empty: nothing."""
    scene, reach = grasps.scene, grasps.reach
    assert scene is not None
    assert reach is not None
    moving = MovingGripper(grasps.mesh, scene.hand, scene.table)
    return [moving.collision(reach, row) for row in range(grasps.size)]


def _print_grasps(grasps: GraspTable, met: list[str]) -> None:
    reach = grasps.reach
    assert reach is not None
    for row in range(grasps.size):
        x, y, z = reach.poses[row, :3, 2]
        angle, margin = np.degrees([grasps.critical_angle[row], reach.approach_margin[row]])
        print(
            f"  {row + 1:2} {Label(int(grasps.label[row])).name}  {angle:5.1f} deg  "
            f"opening {reach.opening[row]:9.4g}  approach {x:5.2f} {y:5.2f} {z:5.2f} "
            f"+-{margin:3.0f} deg  {met[row] or 'free'}",
            flush=True,
        )


def _draw(labels: SurfaceLabels, grasps: GraspTable, path: Path) -> None:
    from grasp3d.plots.figures import save_as
    from grasp3d.plots.grasps import grasp_figure
    from grasp3d.viewer.scene.sheets import draw_grasps

    save_as(grasp_figure(labels, grasps, draw_grasps(labels, grasps)), path)


if __name__ == "__main__":
    sys.exit(main())
