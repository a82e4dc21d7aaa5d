"""Settings of the Python API, the command line and batch runs, as frozen dataclasses.

Docstrings of fields are the command line's help. Angles are radians here; the command line reads
and prints the fields of type `Radians` in degrees. Fields of type `Length` take numbers in the
mesh's unit, or texts with a unit, such as '80mm'.
"""

from typing import Literal

from grasp3d.settings.checks import (
    DEGREE,
    Radians,
    check_choice,
    whole_number,
)
from grasp3d.settings.grasp_model import (
    MAX_FINGERS,
    MAX_SEARCHED_FINGERS,
    MIN_EXTREMES,
    FingerLimits,
    GraspModel,
    check_per_finger,
    check_point_contacts,
    with_fingers,
)
from grasp3d.settings.mesh_options import MeshOptions
from grasp3d.settings.sampling import (
    ANGLE_ROUNDING,
    AnySampling,
    MultifingerSampling,
    Sampling,
    check_search_settings,
    sampling_kind,
    search_cone,
)

__all__ = [
    "ANGLE_ROUNDING",
    "DEGREE",
    "MAX_FINGERS",
    "MAX_SEARCHED_FINGERS",
    "MIN_EXTREMES",
    "AnySampling",
    "FingerLimits",
    "GraspModel",
    "MeshOptions",
    "MultifingerSampling",
    "Radians",
    "Sampling",
    "check_choice",
    "check_per_finger",
    "check_point_contacts",
    "check_search_settings",
    "sampling_kind",
    "search_cone",
    "whole_number",
    "with_fingers",
]

PoseFormat = Literal[
    "json", "csv", "parquet", "isaac_grasp", "acronym", "graspgen", "graspnet", "moveit"
]
"""Formats of files of a gripper's poses."""
