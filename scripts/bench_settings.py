"""Time to make settings, and to read what is known of each finger.

    python scripts/bench_settings.py

Each time is the smallest of many repeats [us]. The model has five fingers, each with an uncertainty
of its own, given as texts: they are parsed when the model is made, not when it is replaced or read.
"""

import timeit
from collections.abc import Callable
from dataclasses import replace

from grasp3d import GraspModel
from grasp3d.mesh.primitives import box_mesh

FINGERS = (
    "location_error=0.1; normal_error=2; friction=0.3..0.4; sensor_resolution=5; "
    "location_error=0.2, normal_error=1, friction=0.5..0.7"
)
CALLS, REPEATS = 2000, 50


def microseconds(work: Callable[[], object]) -> float:
    """Least time of a call [us]."""
    return 1e6 * min(timeit.repeat(work, number=CALLS, repeat=REPEATS)) / CALLS


def main() -> None:
    """Print a line for each."""
    plain, model = GraspModel(), GraspModel(fingers=5, per_finger=FINGERS)
    mesh = box_mesh((1.0, 2.0, 3.0), max_edge=9.0)
    for name, work in {
        "GraspModel()": GraspModel,
        "replace(GraspModel(), friction=0.4)": lambda: replace(plain, friction=0.4),
        "replace(model of five fingers)": lambda: replace(model),
        "its fingertips": lambda: model.fingertips,
        "in the mesh's unit": lambda: mesh.in_own_unit(model),
        "five fingers from their text": lambda: GraspModel(fingers=5, per_finger=FINGERS),
    }.items():
        print(f"{name:36} {microseconds(work):7.2f} us")


if __name__ == "__main__":
    main()
