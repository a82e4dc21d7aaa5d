"""Settings of the Python API, the command line and batch runs, as frozen dataclasses.

Docstrings of fields are the command line's help. Angles are radians here; the command line reads
and prints the fields of type `Radians` in degrees. Fields of type `Length` take numbers in the
mesh's unit, or texts with a unit, such as '80mm'.
"""

from typing import Literal

from grasp3d.settings.checks import (
    DEGREE,
    SEED_LIMIT,
    Radians,
    check_choice,
    whole_number,
)
from grasp3d.settings.grasp_model import (
    MAX_FINGERS,
    MAX_SEARCHED_FINGERS,
    MIN_EXTREMES,
    Actuation,
    ContactModel,
    FingerLimits,
    GraspModel,
    Method,
    Tilts,
    check_per_finger,
    check_point_contacts,
    with_fingers,
)
from grasp3d.settings.mesh_options import (
    MeshOptions,
    Repair,
)
from grasp3d.settings.sampling import (
    ANGLE_ROUNDING,
    AnySampling,
    CandidatePoints,
    Grip,
    MultifingerSampling,
    Sampling,
    check_search_settings,
    sampling_kind,
    search_cone,
)

PoseFormat = Literal[
    "json", "csv", "parquet", "isaac_grasp", "acronym", "graspgen", "graspnet", "moveit"
]
"""Formats of files of a gripper's poses."""

__all__ = [
    "ANGLE_ROUNDING",
    "DEGREE",
    "MAX_FINGERS",
    "MAX_SEARCHED_FINGERS",
    "MIN_EXTREMES",
    "SEED_LIMIT",
    "Actuation",
    "AnySampling",
    "CandidatePoints",
    "ContactModel",
    "FingerLimits",
    "GraspModel",
    "Grip",
    "MeshOptions",
    "Method",
    "MultifingerSampling",
    "PoseFormat",
    "Radians",
    "Repair",
    "Sampling",
    "Tilts",
    "check_choice",
    "check_per_finger",
    "check_point_contacts",
    "check_search_settings",
    "sampling_kind",
    "search_cone",
    "whole_number",
    "with_fingers",
]
