"""The commands `batch` and `sweep`, of many meshes: their options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.cli.options import (
    DegreeRanges,
    Flag,
    Guarded,
    Inputs,
    Labelling,
    LengthRanges,
    Multifinger,
    NumberRanges,
    model_help,
)
from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.settings import MeshOptions, MultifingerSampling, Sampling
from grasp3d.settings.parsing import Group, Main

FRICTIONS, RESOLUTIONS = ("0.2", "0.5", "1.0"), ("0:60:1", "22.6")
"""Default values of friction and sensor resolution of a sweep."""


@dataclass(frozen=True)
class Batch(Labelling):
    """Label every mesh of a library, and write a summary and a report.

    It resumes an earlier run of the same command: meshes whose content and settings are unchanged
    are not labelled again.

    Example:
        # Label all meshes of a folder
        grasp3d batch meshes -o results
        # Only GLB files, which state their unit, with two processes
        grasp3d batch 'meshes/*.glb' -o results_glb --max-opening 80mm --workers 2
    """

    inputs: Inputs

    output: Annotated[
        str, tyro.conf.arg(metavar="FOLDER"), Main("folder for labels, tables and report")
    ]
    """Folder for the results: labels/, fields/, summary/ and report/; also on an object store."""

    cluster: ClusterSettings = field(default_factory=ClusterSettings)

    overwrite: Annotated[Flag, Main("label all meshes again")] = field(default=False, kw_only=True)
    """Label all meshes again, and remove labels of other meshes made with other settings."""

    grid_friction: NumberRanges = ()
    """Coulomb coefficients at which area fractions are computed besides the labels (default: the
    model's)."""

    grid_sensor_resolution: DegreeRanges = ()
    """Sensor resolutions in degrees at which area fractions are computed: numbers, and ranges that
    include both ends (default: 0:60:5 and the model's, with M and U only within the searched cone).
    A grid that is given makes the searched cone large enough for all of it."""

    grid_friction_error: NumberRanges = ()
    """Errors of friction at which area fractions are computed (default: the model's)."""

    grid_normal_error: DegreeRanges = ()
    """Normal errors in degrees at which area fractions are computed (default: the model's)."""

    grid_location_error: LengthRanges = ()
    """Location errors at which area fractions are computed, for the grasps found at the model's
    (default: the model's)."""

    best: Annotated[int, Main("best grasps in the summary of a mesh")] = 5
    """Number of best distinct grasps in the summary of each mesh; 0: none."""

    report: bool = True
    """Write report/index.html."""

    log: Path | None = None
    """File to which a line for each mesh is appended."""

    def __post_init__(self) -> None:
        if not self.inputs:
            raise SettingError("no input: name a folder of meshes, or mesh files")


@dataclass(frozen=True)
class Sweep(Guarded):
    """Compute area fractions of S, M and U over friction and sensor resolution.

    Or over any two of the uncertainties: those that have several values. Also prints the sensor
    resolution that is required for given area fractions of S. Each mesh is labelled once, and once
    more for each further location error, at most five times; for a folder the mean over its meshes
    is added. Writes a table and a figure.

    Example:
        # The circle of the paper and a mug
        grasp3d sweep circle meshes/mug.glb --friction 0.5
        # How fine a sensor half of a folder's surfaces require
        grasp3d sweep 'meshes/*.glb' --friction 0.5 --fraction 0.5 --max-opening 80mm -o glb.csv
    """

    targets: Annotated[
        Inputs,
        tyro.conf.arg(metavar="PATH|circle|square|sphere ..."),
        Main("meshes, folders; circle, square, sphere"),
    ]
    """To be given before the options. Mesh files, folders, which are searched recursively, globs in
    quotes such as 'lib/**/*.stl', lists of these (.txt, one per line); also on an object store
    (s3://BUCKET/FOLDER). Shapes in closed form with one finger fixed: circle, square (in the middle
    of a side) and sphere; ./circle is a file or folder. Shapes have two fingers."""

    output: Annotated[Path | None, Main("table: .csv .parquet")] = None
    """Table (.csv or .parquet) (default: NAME_sweep.csv in this folder, sweep.csv for several
    targets)."""

    figure: Annotated[Path | None, Main("figure: .svg .png .pdf")] = None
    """Figure (.svg, .png or .pdf) (default: the name of the table with the suffix .svg)."""

    friction: Annotated[NumberRanges, Main("frictions")] = FRICTIONS
    """Coulomb coefficients of friction between fingertip and object, above 0. For an interval give
    its middle here and half its width with --friction-error."""

    sensor_resolution: Annotated[
        DegreeRanges,
        model_help(
            "sensor_resolution", "One value or more, in degrees, and ranges that include both ends."
        ),
        Main("sensor resolutions"),
    ] = RESOLUTIONS

    friction_error: NumberRanges = ("0",)
    """Largest difference between the true friction and the coefficient, to either side; smaller
    than the coefficient. --friction 0.5 --friction-error 0.1: from 0.4 to 0.6."""

    normal_error: Annotated[DegreeRanges, model_help("normal_error", "In degrees.")] = ("0",)

    location_error: LengthRanges = ("0",)
    """Largest distance between the true and the perceived contact point, a length; for shapes in
    closed form as a part of their radius or half side. Where errors have several values, those of
    friction and sensor resolution are 0.5 and 22.6 unless they are given."""

    heat_map: Flag = False
    """Draw S and M as heat maps over both axes, also for friction and sensor resolution, and for
    four rows or fewer, which otherwise have a panel each."""

    fraction: Annotated[tuple[float, ...], Main("area fractions of S")] = (0.5, 0.9)
    """Area fractions of S, above 0 and at most 1. For each the required sensor resolution is
    printed: at any smaller one at least this fraction of the surface is S."""

    fingers: Annotated[int, model_help("fingers"), Group("gripper")] = 2

    sampling: Sampling = field(default_factory=Sampling)

    multifinger: Multifinger = field(default_factory=MultifingerSampling)

    reach: ReachSettings = field(default_factory=ReachSettings)

    mesh: MeshOptions = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)

    def __post_init__(self) -> None:
        for fraction in self.fraction:
            if not 0.0 < fraction <= 1.0:
                raise SettingError(f"each fraction must be above 0 and at most 1; got {fraction:g}")
