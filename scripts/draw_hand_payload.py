"""Draw what a hand holds over friction and sensor resolution, and the joint that limits it.

    python scripts/draw_hand_payload.py FILE.urdf PICTURE [--preset allegro]

The hand closes on a ball from random poses of its base; of the grasps that it makes the one is
drawn that surely holds most at a friction of 0.8 and a resolution of 15 degrees.
"""

import argparse
import math
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from matplotlib.colors import ListedColormap
from matplotlib.ticker import MaxNLocator

import grasp3d
from grasp3d.grasps import GraspPoses
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.grasps.motor_holding import MotorForces
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.plots.figures import styled
from grasp3d.quality import HandPayload, Weight, hand_payload

RADIUS, TRIES, SPREAD = 0.035, 40, 0.015
FRICTIONS, RESOLUTIONS = np.linspace(0.2, 1.2, 26), np.radians(np.linspace(0.0, 60.0, 31))
COLORS = ("#56B4E9", "#E69F00", "#009E73", "#CC79A7", "#F0E442", "#0072B2", "#D55E00", "#666666")


def best_grasp(
    hand: ArticulatedHand, torque: float | None, middle: list[float]
) -> tuple[MotorForces, int]:
    """The grasp of a ball that surely holds most, of random poses."""
    generator = np.random.default_rng(0)
    poses = np.tile(np.eye(4), (TRIES, 1, 1))
    poses[:, :3, 3] = -np.array(middle) - SPREAD * generator.uniform(-1.0, 1.0, size=(TRIES, 3))
    given = GraspPoses(
        poses=poses, posture=np.tile(hand.preshapes["open"], (TRIES, 1)),
        joint_names=hand.joint_names, unit="m",
    )  # fmt: skip
    found = grasp3d.evaluate_grasps(
        grasp3d.load_mesh(trimesh.creation.icosphere(3, RADIUS), unit="m"), given,
        grasp3d.GraspModel(friction=0.8, sensor_resolution=math.radians(15.0)), hand=hand,
        contact_rule="closed", load=grasp3d.Load(torque_limits=torque),
    )  # fmt: skip
    assert isinstance(found, EvaluatedHandGrasps)
    holding = found.motor_holding
    assert holding is not None
    print(holding.verdict(found.reachable))
    surely = np.where(found.reachable, np.nan_to_num(holding.payload_sure), -1.0)
    return holding.forces, int(surely.argmax())


def held(forces: MotorForces, row: int) -> list[list[HandPayload]]:
    """Payloads in any direction, for each friction and resolution."""
    contacts = np.flatnonzero(forces.sets.row == row)
    felt = contacts[~np.isnan(forces.tilts[contacts])]
    return [
        [
            hand_payload(forces.grasp(row, felt, float(friction)), Weight(), tilt=0.5 * resolution)
            for friction in FRICTIONS
        ]
        for resolution in RESOLUTIONS
    ]


@styled
def draw(found: list[list[HandPayload]], name: str, path: Path) -> None:
    """Draw the masses, and which joint limits them."""
    masses = np.array([[one.lower for one in row] for row in found])
    limits = np.array([[one.limit if one.lower > 0.0 else "" for one in row] for row in found])
    names = [limit for limit in np.unique(limits) if limit]
    codes = np.array([[names.index(one) if one else -1 for one in row] for row in limits])
    figure, axes = plt.subplots(1, 2, figsize=(7.2, 3.0), layout="constrained", sharey=True)
    degrees = np.degrees(RESOLUTIONS)
    levels = MaxNLocator(9).tick_values(0.0, masses.max())
    filled = axes[0].contourf(FRICTIONS, degrees, masses, levels=levels, cmap="viridis")
    figure.colorbar(filled, ax=axes[0], label="surely held [kg]", format="%.2g")
    shown = np.ma.masked_less(codes, 0)
    colors = ListedColormap([COLORS[k % len(COLORS)] for k in range(max(1, len(names)))])
    axes[1].pcolormesh(FRICTIONS, degrees, shown, cmap=colors, vmin=-0.5, vmax=len(names) - 0.5)
    for code, limit in enumerate(names):
        axes[1].plot([], [], "s", color=colors(code), label=limit.replace("_", " "))
    axes[1].legend(loc="center left", bbox_to_anchor=(1.0, 0.5), fontsize=7, frameon=False)
    for panel, title in zip(axes, (f"{name}, any orientation", "what limits it"), strict=True):
        panel.plot(FRICTIONS, 2.0 * np.degrees(np.arctan(FRICTIONS)), "k--", linewidth=0.8)
        panel.set(xlabel="friction", title=title, xlim=FRICTIONS[[0, -1]], ylim=(0, 60))
    axes[0].set_ylabel("sensor resolution [°]")
    figure.savefig(path, dpi=160)
    plt.close(figure)


def main() -> None:
    """Evaluate and draw."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("hand", type=Path)
    parser.add_argument("picture", type=Path)
    parser.add_argument("--preset")
    parser.add_argument("--torque", type=float, help="of every motor [N m]")
    parser.add_argument(
        "--middle", type=float, nargs=3, default=[0.09, 0.0, 0.02],
        help="about where the ball is in the hand's frame [m]",
    )  # fmt: skip
    options = parser.parse_args()
    hand = grasp3d.read_hand(options.hand, preset=options.preset)
    assert isinstance(hand, ArticulatedHand)
    forces, row = best_grasp(hand, options.torque, options.middle)
    draw(held(forces, row), hand.name, options.picture)


if __name__ == "__main__":
    main()
