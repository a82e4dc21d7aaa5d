"""Compare the time of exact labels with that of the paper's enumeration of extreme normals.

    python scripts/bench_extremes.py

Both label the same grasps in the same run, on one thread: random grasps of 2 to 4 fingers, and the
best grasps on surfaces, whose search is common to both.
"""

import sys
from pathlib import Path

import numpy as np
from bench_epsilon import best_time

sys.path.insert(0, str(Path(__file__).parents[1]))

import grasp3d
from tests.helpers.random_grasps import random_grasps

LIBRARY = Path(__file__).parents[1] / "meshes"
GRASPS = {2: 2000, 3: 500, 4: 200}
RIMS = {2: (8, 32), 3: (8, 16), 4: (8,)}
MESHES = ("mug.glb", "box.obj", "banana.ply")


def of_grasps(fingers: int) -> None:
    """Print a line for each number of extreme normals."""
    contacts, resolution = random_grasps(fingers, GRASPS[fingers])
    exact = best_time(lambda: grasp3d.classify(contacts, resolution))
    for count in RIMS[fingers]:

        def sampled(count: int = count) -> grasp3d.Stability:
            return grasp3d.classify(contacts, resolution, method="extremes", extreme_normals=count)

        seconds, found = best_time(sampled), sampled()
        print(
            f"{fingers} fingers, rim of {count:2}: exact {1e6 * exact / GRASPS[fingers]:6.1f} us, "
            f"extremes {1e6 * seconds / GRASPS[fingers]:9.1f} us per grasp "
            f"({1e6 * seconds / found.hulls.sum():.2f} us per hull, {found.hulls.mean():.0f} of "
            f"{found.combinations} hulls), ratio {seconds / exact:.0f}"
        )


def of_surface(name: str) -> None:
    """Print a line for one mesh."""
    mesh = grasp3d.load_mesh(LIBRARY / name)
    exact = grasp3d.label_surface(mesh)
    search = best_time(lambda: grasp3d.label_surface(mesh))
    model = grasp3d.GraspModel(method="extremes")
    seconds = best_time(lambda: grasp3d.label_surface(mesh, model))
    sampled = grasp3d.label_surface(mesh, model)
    differ = mesh.vertex_areas[exact.label != sampled.label].sum() / mesh.vertex_areas.sum()
    print(
        f"{name}: {len(np.unique(mesh.canonical))} positions, "
        f"search and exact labels {search:.2f} s, "
        f"search and extremes {seconds:.2f} s, ratio {seconds / search:.1f}; "
        f"{100.0 * differ:.2f} % of the area labelled differently"
    )


def main() -> None:
    """Print all measurements."""
    warm_up = grasp3d.GraspModel(method="extremes")
    grasp3d.label_surface(grasp3d.load_mesh(LIBRARY / MESHES[1]), warm_up)
    for fingers in GRASPS:
        of_grasps(fingers)
    for name in MESHES:
        of_surface(name)


if __name__ == "__main__":
    with grasp3d.running(threads=1):
        main()
