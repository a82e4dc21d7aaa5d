"""Compare collisions of grippers with python-fcl: `python scripts/validate_reach.py`.

Random poses of three grippers about four meshes, half of them external grasps and half internal
ones: fingers, palm and round tips are swept out of the object. FCL decides twice, for parts larger
and smaller by 1e-6 of the object's size; where it differs from itself a pose is touching, and not
compared. Disagreements must be 0.
"""

import argparse
import sys
import time
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from grasp3d import load_mesh
from grasp3d.hand.jaw_reach import collides
from grasp3d.settings.lengths import METRES
from tests.helpers.collisions import Oracle
from tests.helpers.grippers import GRIPPERS, normalized_poses, random_poses

ROOT = Path(__file__).parents[1]
MESHES = tuple(f"meshes/{name}" for name in ("mug.glb", "torus.glb", "spray.glb", "banana.ply"))


def main() -> int:
    """Print a row for each mesh and gripper; 1 where a verdict differs."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("meshes", nargs="*", default=[ROOT / name for name in MESHES])
    parser.add_argument("--poses", type=int, default=60_000, help="of all meshes and grippers")
    parser.add_argument("--unit", default="m", help="of meshes that state none")
    options = parser.parse_args()
    each = options.poses // (len(options.meshes) * len(GRIPPERS))
    print(f"{'mesh':28}{'gripper':9}{'poses':>7}{'collide':>9}{'touch':>7}{'differ':>8}{'s':>7}")
    differing = 0
    for path in options.meshes:
        stated = Path(path).suffix in {".glb", ".gltf", ".3mf"}
        mesh = load_mesh(path, unit=None if stated else options.unit)
        assert mesh.unit is not None
        metres = METRES[mesh.unit]
        oracle = Oracle(mesh.contact_surface.points, mesh.contact_surface.faces)
        for number, hand in enumerate(GRIPPERS):
            start = time.perf_counter()
            poses, openings = random_poses(mesh, each, seed=number)
            grips = np.where(np.arange(each) % 2, 1, -1)
            found = collides(mesh, poses, openings / metres, hand, grip=grips)
            scale = 1.0 / (metres * mesh.size)
            right = [
                oracle.collides(pose, opening * scale, hand, scale, grip=grip)
                for pose, opening, grip in zip(
                    normalized_poses(mesh, poses), openings, grips.tolist(), strict=True
                )
            ]
            touching = sum(one is None for one in right)
            differ = sum(
                a is not None and a != b for a, b in zip(right, found.tolist(), strict=True)
            )
            differing += differ
            print(
                f"{Path(path).name:28}{hand.name:9}{each:7}{found.sum():9}{touching:7}"
                f"{differ:8}{time.perf_counter() - start:7.1f}",
                flush=True,
            )
    print(f"disagreements: {differing}")
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())
