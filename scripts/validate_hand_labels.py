"""Labels of grasps with blind contacts against linear programs at normals that may be true.

Random grasps of 2 to 6 contacts with different sensor resolutions, of which about a third are
blind. Each is tried at random normals, at those turned away from the motion that is hardest to
resist, and at those turned toward forces in equilibrium. Closure is decided on both sides, with
pyramids inside the cones and around them: an S must close at all of them, a U at none. Of the M it
is counted how many were seen to do both.

    python scripts/validate_hand_labels.py --grasps 3000
"""

import argparse
import sys
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from grasp3d import Label
from grasp3d.stability.contact_sets import label_sets
from tests.helpers.contact_sets import closes, random_sets, true_normals

PART = 100


def main() -> None:
    """Count contradictions and print them."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grasps", type=int, default=300)
    parser.add_argument("--normals", type=int, default=4, help="random normals of each grasp")
    options = parser.parse_args()
    counts = np.zeros(len(Label), dtype=np.int64)
    wrong, both, programs = {Label.S: 0, Label.U: 0}, 0, 0
    for part in range(0, options.grasps, PART):
        one = random_sets(min(PART, options.grasps - part), 1000 + part)
        label = label_sets(one.sets, one.tilt, one.angles).label
        counts += np.bincount(label, minlength=len(Label))
        rng = np.random.default_rng(part)
        for grasp in range(one.sets.size):
            points = one.sets.points[one.sets.row == grasp]
            tried = true_normals(one, grasp, options.normals, rng)
            closed, open_ = (
                [
                    closes(points, normals, one.friction, around=around) != around
                    for normals in tried
                ]
                for around in (False, True)
            )
            programs += 2 * len(tried)
            wrong[Label.S] += int(label[grasp] == Label.S and any(open_))
            wrong[Label.U] += int(label[grasp] == Label.U and any(closed))
            both += int(label[grasp] == Label.M and any(open_) and any(closed))
    names = ", ".join(f"{counts[one]} {one.name}" for one in sorted(Label, reverse=True))
    print(f"{options.grasps} grasps: {names}; {programs} linear programs")
    print(f"S that open: {wrong[Label.S]}; U that hold: {wrong[Label.U]}")
    print(f"M seen to do both: {both} of {counts[Label.M]}")


if __name__ == "__main__":
    main()
