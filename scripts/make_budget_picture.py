"""Draw what each uncertainty takes of the friction angle, for grasps of several widths.

    python scripts/make_budget_picture.py -o docs/budgets.png

Antipodal grasps of a finger with a round tip of 20 mm diameter, a receptive field of 4 mm, encoders
of 12 bits at two joints, and a friction of 0.4 to 0.6. The wider the grasp, the less the line
between the contacts may turn.
"""

import argparse
from pathlib import Path

import grasp3d
from grasp3d.contact import FingerDesign, GraspSamples, JointEncoders
from grasp3d.plots.budgets import budget_figure
from grasp3d.plots.formats import save_as

DESIGN = FingerDesign(
    friction=(0.4, 0.6),
    sensor=grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0),
    encoders=JointEncoders(counts=4096, lengths=(60.0, 30.0)),
)
OPENINGS = (10.0, 15.0, 25.0, 40.0, 80.0)
"""Distances between the contacts [mm]."""


def main() -> None:
    """Draw the picture."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("-o", "--output", type=Path, required=True)
    budgets = {
        f"{opening:.0f} mm": DESIGN.budget(GraspSamples(0.0, opening)).mean()
        for opening in OPENINGS
    }
    save_as(budget_figure(budgets), parser.parse_args().output)


if __name__ == "__main__":
    main()
