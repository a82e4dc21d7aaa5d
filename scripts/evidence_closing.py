"""What each step of closing the jaws adds to the prediction of outcomes.

    python scripts/evidence_closing.py GRASPS --mesh MESH [--friction MU] [--resolution DEG]

GRASPS is a file of poses with outcomes, as for `grasp3d validate`. The table has the rules by which
a pose becomes two contacts, each with one step more than the one before; then the whole rule with a
single step changed. For each it gives the area under the ROC curve of -beta*, the success within S,
M and U, and the number of poses whose jaws do not close, which count as U. Nothing is fitted to the
outcomes. For files of ACRONYM there is also the rank correlation of the angle by which the object
turns with the angle that the simulator recorded.
"""

import argparse
import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.stats import spearmanr

import grasp3d
from grasp3d.arrays import Bools, Floats
from grasp3d.formats import GraspPoses
from grasp3d.hand import closing
from grasp3d.hand.closing import close_jaws
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.outcomes.success import success_rate
from grasp3d.outcomes.tried_grasps import check_grasps, stated_object
from grasp3d.outcomes.validation import roc_auc
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.stability.label import Label, label_angles

THIN = 2e-4
"""Side of pads that stand for the axis through the TCP [m]."""


@contextmanager
def changed(module: Any, name: str, value: Any) -> Iterator[None]:
    """Change a module's constant or function temporarily, as the steps are not settings."""
    before = getattr(module, name)
    setattr(module, name, value)
    try:
        yield
    finally:
        setattr(module, name, before)


@dataclass(frozen=True)
class Rule:
    """A rule by which poses become contacts."""

    text: str
    hand: ParallelGripper
    friction: float | None
    """Friction with a free object; None if it is fixed."""
    footprint: float = 0.0
    """Depth of the surface opposite a jaw that gives the normal, relative to the pad's side."""
    pressed: bool = True
    """Whether contacts are centres of pressure."""

    def close(self, mesh: grasp3d.ObjectMesh, poses: Any) -> closing.ClosedJaws:
        """Close the jaws."""
        keep: Callable[..., Any] = closing.centres_of_pressure
        with (
            changed(closing, "FOOTPRINT", self.footprint),
            changed(closing, "centres_of_pressure", keep if self.pressed else centroids),
        ):
            return close_jaws(
                mesh,
                poses,
                self.hand,
                object_motion="fixed" if self.friction is None else "free",
                friction=self.friction or 0.0,
            )


def centroids(points: Any, *_: Any) -> Any:
    """Return the patches' centroids, in place of the centres of pressure."""
    return points


def rules(hand: ParallelGripper, friction: float) -> Iterator[Rule]:
    """Yield rules with one step more each, then the whole rule with one step changed."""
    pads = replace(hand, inner_faces=(), tip_thickness=None)
    rigid = replace(pads, compliance=0.0)
    thin = replace(rigid, pad_width=THIN, pad_height=THIN)
    rubbed = Rule("with friction", pads, friction, pressed=False)
    one_line = replace(rubbed, text="forces on one line: centres of pressure", pressed=True)
    opposite = replace(one_line, text="the slope opposite the pads", footprint=closing.FOOTPRINT)
    yield Rule("the axis through the TCP meets the surface", thin, None)
    yield Rule("rigid flat pads touch a fixed object", rigid, None)
    yield Rule("pads give way: a patch, not a point", pads, None)
    yield replace(rubbed, text="the object settles, without friction", friction=0.0)
    yield rubbed
    yield one_line
    yield opposite
    whole = replace(opposite, text="**the fingers' own faces: the whole rule**", hand=hand)
    yield whole
    yield replace(whole, text="whole, but a fixed object", friction=None)
    yield replace(whole, text="whole, but without friction", friction=0.0)
    yield replace(whole, text="whole, but rigid", hand=replace(hand, compliance=0.0))
    yield replace(whole, text="whole, but centroids", pressed=False)
    yield replace(whole, text="whole, but only the patch's slope", footprint=0.0)
    for depth in (0.25, 0.5, 0.7):
        text = f"whole, but the slope within {depth:g} of the pad's side"
        yield replace(whole, text=text, footprint=depth)


def angles_of(found: closing.ClosedJaws) -> Floats:
    """Critical friction angles of point contacts [rad]; pi if the jaws do not close."""
    angles = np.full(len(found.state), math.pi)
    points, normals = found.points[found.closed], found.normals[found.closed]
    angles[found.closed] = critical_friction_angle(grasp3d.Contacts(points, normals, 0.5))
    return angles


def row(rule: Rule, mesh: grasp3d.ObjectMesh, poses: GraspPoses, model: grasp3d.GraspModel) -> str:
    """Write a row of the table."""
    found = rule.close(mesh, poses.poses)
    angles = angles_of(found)
    held = poses.outcome == 1.0
    codes = label_angles(angles, angles, model)
    rates = [success_rate(name, held[codes == Label[name]]) for name in "SMU"]
    cells = [f"{100.0 * one.rate:.0f} % of {one.count}" for one in rates]
    values = [rule.text, area_of(held, angles), *cells, str(np.count_nonzero(~found.closed))]
    return f"| {' | '.join(values)} |"


def area_of(held: Bools, angles: Floats) -> str:
    """Write the area under the ROC curve of -beta*."""
    return f"{roc_auc(held, -angles, np.arange(len(held)))[0]:.3f}"


def turn_agreement(path: Path, found: closing.ClosedJaws, held: Bools) -> str:
    """Write rank correlations of the object's turn with that recorded by ACRONYM's simulator."""
    with h5py.File(path) as file:
        recorded = file["grasps/qualities/flex/object_motion_during_closing_angular"][()]
    values = [
        spearmanr(found.turn[rows], recorded[rows]).statistic
        for rows in (found.closed & held, found.closed)
    ]
    return (
        f"turn of the object against the simulator's: rank correlation {values[0]:.2f} over the "
        f"grasps that held, {values[1]:.2f} over all that close"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("grasps", type=Path)
    parser.add_argument("--mesh", type=Path, required=True)
    parser.add_argument("--friction", type=float, default=0.5)
    parser.add_argument("--resolution", type=float, default=22.6, help="degrees")
    given = parser.parse_args()
    model = grasp3d.GraspModel(
        friction=given.friction, sensor_resolution=math.radians(given.resolution)
    )
    (tried,) = check_grasps([given.grasps], mesh=given.mesh)
    poses = tried.poses
    mesh = stated_object(tried.mesh, poses, None, None).mesh
    assert mesh.unit is not None  # outcomes are compared in metres
    poses = poses.in_unit(mesh.unit)
    print(f"{poses.count} grasps; μ {given.friction:g}, α {given.resolution:g}°\n")
    print("| contacts | ROC-AUC of -β* | S held | M held | U held | not closed |")
    print("|---|---|---|---|---|---|")
    for rule in rules(tried.hand, given.friction):
        print(row(rule, mesh, poses, model), flush=True)
    if given.grasps.suffix == ".h5":
        whole = close_jaws(
            mesh, poses.poses, tried.hand, object_motion="free", friction=given.friction
        )
        print("\n" + turn_agreement(given.grasps, whole, poses.outcome == 1.0))
        closed = area_of(poses.outcome[whole.closed] == 1.0, angles_of(whole)[whole.closed])
        print(f"only where the jaws close: ROC-AUC {closed}")


if __name__ == "__main__":
    main()
