"""The commands `evaluate`, `validate` and `simulate`, of given or drawn grasps: their options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.cli.options import (
    DegreeRanges,
    Force,
    InputFile,
    LengthOption,
    LoadGroup,
    MeshGroup,
    NumberRanges,
    ObjectPoseOption,
    OutputFile,
    Overwrite,
    Quiet,
    Strict,
    without,
)
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.hand import Hand
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions
from grasp3d.validating.validation_settings import ValidationSettings


@dataclass(frozen=True)
class Evaluate:
    """Evaluate given grasps: label, critical friction angle and epsilon of each.

    Each contact is moved to the closest point of the surface. At poses of a gripper its jaws are
    closed on the object.

    Example:
        # Evaluate the grasps in a table, in the unit of the mesh
        grasp3d evaluate meshes/mug.glb grasps.csv --friction 0.8
        # Accept contacts up to 5 mm from the surface
        grasp3d evaluate meshes/mug.glb grasps.csv --max-distance 5mm -o evaluated.json
    """

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    contacts: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CONTACTS")]
    """Contact points in the mesh's frame and unit: CSV or Parquet with columns x1 y1 z1 x2 y2 z2
    ... and one row per grasp, or JSON with a list of grasps, each a list of points [x, y, z]. Or
    poses of a gripper: the files that grasp3d writes, isaac_grasp (.yaml), ACRONYM (.h5), GraspNet
    (.npy), GraspGen and moveit_msgs/Grasp (.json); they need --hand."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Results (.csv, .parquet or .json) (default: NAME_grasps.csv in this folder)."""

    max_distance: LengthOption = None
    """Largest distance of a contact from the surface (default: 1/100 of the object's size)."""

    metrics: Annotated[
        str | None, tyro.conf.arg(metavar="all|NAME,NAME", help_behavior_hint="")
    ] = None
    """Quality measures of the literature to compute, print and write as further columns: all, or
    names separated by commas, such as min_weight,grasp_isotropy; an unknown name lists them."""

    object_motion: ObjectMotion = "free"
    """Poses: whether the object gives way to the closing jaws, and settles between them, or does
    not move."""

    object_pose: ObjectPoseOption = None
    """Pose of the object in the frame of the poses, for poses in a robot's frame whose file does
    not state it: x=0.4m,z=0.1m,yaw=90deg (also y, roll, pitch; or qx, qy, qz, qw), or a file of it
    (default: the poses are in the mesh's frame, or as their file states)."""

    model: GraspModel = field(default_factory=GraspModel)
    """Friction and sensor resolution; the number of fingers is that of a grasp's contacts."""

    reach: ReachSettings = field(default_factory=ReachSettings)
    """The gripper of the poses, and what the object stands on."""

    load: LoadGroup = field(default_factory=Load)

    mesh: MeshGroup = field(default_factory=MeshOptions)

    force: Force = False

    strict: Strict = False

    overwrite: Overwrite = False

    quiet: Quiet = False


@dataclass(frozen=True)
class Validate:
    """Compare labels and scores of grasps with what became of them.

    Closes the gripper's jaws at poses of which it is known whether the grasp held, and prints how
    well label, margin, epsilon, grip force and simpler scores predict it: area under the ROC curve,
    success within S, M and U, calibration of the margin, and the greatest disagreements.

    Example:
        # How well labels predict a robot's log of grasps on one object
        grasp3d validate tried.csv --mesh meshes/mug.glb --hand franka -o validated
        # For rubber pads, with a table of S, M and U at other resolutions
        grasp3d validate tried.csv --mesh meshes/mug.glb --friction 0.8 --sensor-resolutions 0:20:5
    """

    grasps: Annotated[
        tuple[Path, ...],
        tyro.conf.Positional,
        tyro.conf.arg(metavar="GRASPS [GRASPS ...]", help_behavior_hint=""),
    ]
    """Files of poses with outcomes: tables (.csv, .parquet) with px py pz qx qy qz qw and a column
    success (or outcome) of 1 or 0, true or false, yes or no, empty where it was not tried; ACRONYM
    (.h5); GraspGen and the files that grasp3d writes (.json)."""

    output: Annotated[
        Path | None, tyro.conf.arg(aliases=["-o"], metavar="FOLDER", help_behavior_hint="")
    ] = None
    """Folder for the report: report.html, with figures and pictures, and its tables as CSV
    (default: only prints)."""

    mesh_file: Annotated[
        Path | None, tyro.conf.arg(name="mesh", metavar="FILE", help_behavior_hint="")
    ] = None
    """Mesh of the object of all grasps (default: the one that each file of grasps names, in the
    scale that it states)."""

    meshes: Annotated[Path | None, tyro.conf.arg(metavar="FOLDER", help_behavior_hint="")] = None
    """Folder in which these meshes are looked up, by their path, then by their base name (default:
    the folder of each file of grasps)."""

    frictions: NumberRanges = ("0.3", "0.5", "1.0")
    """Coefficients of friction of the table of S, M and U."""

    sensor_resolutions: DegreeRanges = ("0", "10", "22.6", "40")
    """Sensor resolutions of that table."""

    statistics: Annotated[
        ValidationSettings, without(ValidationSettings, "frictions", "sensor_resolutions")
    ] = field(default_factory=ValidationSettings)
    """What is computed from outcomes, and listed."""

    model: Annotated[
        GraspModel, without(GraspModel, "fingers", "per_finger", "method", "extreme_normals")
    ] = field(default_factory=GraspModel)
    """Friction and sensor resolution of label, margin, epsilon and grip force."""

    reach: ReachSettings = field(default_factory=ReachSettings)
    """The gripper of the poses, unless their files state a known one (ACRONYM: the Franka hand),
    and what the objects stand on."""

    load: Load = field(default_factory=Load)
    """What each grasp must hold; without a mass or density that of the file, if it states one."""

    surface: MeshOptions = field(default_factory=MeshOptions)
    """How meshes are read and prepared. A LENGTH is a number in the mesh's unit, or has a unit."""

    object_motion: ObjectMotion = "free"
    """Whether objects give way to the closing jaws: they settle between them, or do not move."""

    strict: Strict = False

    overwrite: Overwrite = False

    quiet: Quiet = False


@dataclass(frozen=True)
class Simulate:
    """Simulate labelled grasps in MuJoCo: do S hold, and U fail?

    Draws pairs of contacts from the surface, labels them from what a sensor perceives of them, and
    simulates them as they truly are: two round tips press on the object, which is then pulled by
    its weight in six directions. With --grasps, a gripper closes at given poses instead. Needs the
    extra: pip install 'grasp3d[physics]'.

    Example:
        # Do grasps of a box hold as their labels say?
        grasp3d simulate meshes/box.obj --unit m --count 6 --pull-time 0.2
        # With uncertain friction, as a table of Parquet
        grasp3d simulate meshes/box.obj --unit m --friction 0.4..0.6 --count 6 -o simulated.parquet
    """

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Table with a row for each grasp (.csv or .parquet), or poses with outcomes in any format that
    has them (default: NAME_simulation.csv in this folder)."""

    grasps: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """File of poses of a gripper to simulate, in any format that grasp3d evaluate reads (default:
    grasps are drawn from the surface)."""

    object_pose: ObjectPoseOption = None
    """Pose of the object in the frame of the poses, for poses in a robot's frame whose file does
    not state it: x=0.4m,z=0.1m,yaw=90deg (also y, roll, pitch; or qx, qy, qz, qw), or a file of it
    (default: the poses are in the mesh's frame, or as their file states)."""

    hand: Annotated[Hand | None, tyro.conf.arg(help_behavior_hint="")] = None
    """Name of a preset, or a file, of the gripper of the poses. Of drawn grasps: a gripper with
    round tips, whose radius and limits of the opening are taken (default: tips of --tip-radius)."""

    min_opening: LengthOption = 0.0
    """Smallest distance between the contacts, a length (default: 0)."""

    max_opening: LengthOption = None
    """Largest distance between the contacts, a length (default: none)."""

    simulation: SimulationSettings = field(default_factory=SimulationSettings)
    """Grasps, tips, forces and limits of the simulation. A LENGTH is a number in the mesh's unit,
    or has a unit: 3mm."""

    model: Annotated[
        GraspModel,
        without(GraspModel, "fingers", "method", "extreme_normals", "edges", "actuation"),
    ] = field(default_factory=GraspModel)
    """Friction and what is uncertain, from which labels follow, and within which the true contacts
    are drawn."""

    mesh: MeshGroup = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)
    """Which processes simulate, with their limits; each simulates a few grasps at a time."""

    force: Force = False

    strict: Strict = False

    overwrite: Overwrite = False

    quiet: Quiet = False
