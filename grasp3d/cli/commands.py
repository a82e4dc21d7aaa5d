"""The commands on meshes, libraries of them, and grasps: their options."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.cli.options import (
    POSITIONAL,
    REPEATED,
    DegreeRanges,
    FrameOption,
    GivenPoses,
    Guarded,
    Inputs,
    Labelling,
    LengthOption,
    LoadOfJaws,
    MeshFile,
    NumberRanges,
    ObjectPoseOption,
    OutcomeOption,
    Overwriting,
    Quiet,
    Searching,
    Stated,
    Strict,
    WholeMesh,
    without,
)
from grasp3d.errors import SettingError
from grasp3d.hand.choices import ContactRule, ObjectMotion
from grasp3d.hand.hand import Hand
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import (
    GraspModel,
    MeshOptions,
    PoseFormat,
    Sampling,
)
from grasp3d.settings.parsing import Group, Main
from grasp3d.settings.units import parse_lengths
from grasp3d.validating.validation_settings import ValidationSettings
from grasp3d.viewer.view_settings import ViewSettings


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

    output: Annotated[str, Stated(metavar="FOLDER"), Main("folder for labels, tables and report")]
    """Folder for the results: labels/, fields/, summary/ and report/; also on an object store."""

    cluster: ClusterSettings = field(default_factory=ClusterSettings)

    overwrite: Annotated[bool, Main("label all meshes again")] = field(default=False, kw_only=True)
    """Label all meshes again, and remove labels of other meshes made with other settings."""

    best: Annotated[int, Main("best grasps in the summary of a mesh")] = 5
    """Number of best distinct grasps in the summary of each mesh; 0: none."""

    report: bool = True
    """Write report/index.html."""

    def __post_init__(self) -> None:
        if not self.inputs:
            raise SettingError("no input: name a folder of meshes, or mesh files")


@dataclass(frozen=True)
class Sweep(Guarded):
    """Compute area fractions of S, M and U over friction and sensor resolution.

    Also prints the sensor resolution that is required for given area fractions of S. Each mesh is
    labelled once; of several meshes the mean is added. Writes a table and a figure.

    Example:
        # The circle of the paper and a mug
        grasp3d sweep circle meshes/mug.glb --friction 0.5
        # How fine a sensor half of a folder's surfaces require
        grasp3d sweep 'meshes/*.glb' --friction 0.5 --fraction 0.5 --max-opening 80mm -o glb.csv
    """

    targets: Annotated[
        Inputs,
        Stated(metavar="PATH|circle|square|sphere ..."),
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

    friction: Annotated[NumberRanges, Main("frictions")] = ("0.2", "0.5", "1.0")
    """Coulomb coefficients of friction between fingertip and object, above 0."""

    sensor_resolution: Annotated[DegreeRanges, Main("sensor resolutions")] = ("0:60:1", "22.6")
    """Resolutions of the fingertips' sensors: the smallest angle between two normals that they can
    tell apart. One value or more, in degrees, and ranges that include both ends."""

    fraction: Annotated[tuple[float, ...], Main("area fractions of S")] = (0.5, 0.9)
    """Area fractions of S, above 0 and at most 1. For each the required sensor resolution is
    printed: at any smaller one at least this fraction of the surface is S."""

    fingers: Annotated[int, Group("hand")] = 2
    """Number of fingers, from 2 to 5."""

    sampling: Sampling = field(default_factory=Sampling)

    reach: Annotated[ReachSettings, without(ReachSettings, "pose_error")] = field(
        default_factory=ReachSettings
    )

    mesh: MeshOptions = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)

    def __post_init__(self) -> None:
        for fraction in self.fraction:
            if not 0.0 < fraction <= 1.0:
                raise SettingError(f"each fraction must be above 0 and at most 1; got {fraction:g}")


At = Annotated[tuple[str, ...], REPEATED, Stated(metavar="X,Y,Z")]
"""Points of a surface, in metres or each length with a unit."""


@dataclass(frozen=True)
class Label(Labelling):
    """Label one mesh: print area fractions of S, M and U, write the labelled mesh.

    Example:
        # Label a mug for a gripper that opens 60 mm
        grasp3d label meshes/mug.glb --max-opening 60mm
        # The best grasps of three fingers, for a mesh whose file states no unit
        grasp3d label meshes/box.obj --unit m --fingers 3 --max-opening 12cm --best 4
    """

    file: MeshFile

    output: Annotated[Path | None, Main("labelled file: .ply .glb .npz .vtp .parquet")] = None
    """Labelled file (.ply, .glb, .npz, .vtp or .parquet) (default: NAME_labeled.ply in this
    folder)."""

    best: Annotated[int | None, Main("how many best grasps to print and write")] = None
    """Number of best distinct grasps to print and to write to a file, with a picture (.png) of the
    same name beside it."""

    grasps: Path | None = None
    """File of the best grasps of --best (.json, .csv, .parquet; with a gripper also .yaml for
    isaac_grasp, .h5 for ACRONYM, .npy for graspnetAPI) (default: NAME_grasps.json in the folder of
    the labelled file)."""

    grasps_format: PoseFormat | None = None
    """With a gripper: format of that file, where its suffix stands for several (default: the first
    of that suffix)."""

    object_pose: ObjectPoseOption = None
    """With a gripper: pose of the object in your robot's frame, in which that file then has its
    poses: x,y,z,yaw in metres and degrees, x,y,z,qx,qy,qz,qw, or a file of it (default: the poses
    are in the mesh's frame)."""

    frame: FrameOption = None
    """With a gripper: frame of the gripper in which that file is to have the poses, such as
    graspgen, or a file, as grasp3d evaluate takes it (default: that of the format)."""

    at: At = ()
    """Also print the label, the grasp and the reason at the vertex nearest to this point of the
    surface; may be stated several times."""

    def __post_init__(self) -> None:
        if self.best is not None and self.best < 1:
            raise SettingError(f"best must be at least 1; got {self.best}")
        for name in ("grasps", "grasps_format", "object_pose", "frame"):
            if getattr(self, name) is not None and self.best is None:
                raise SettingError(f"{name} is for the best grasps; give their number with --best")
        if self.grasps_format == "graspgen":
            raise SettingError(
                "graspgen files state which grasps held, which is not known of grasps that are "
                "found; choose another grasps_format"
            )
        for name in ("grasps_format", "object_pose", "frame"):
            if getattr(self, name) is not None and self.posed_hand is None:
                raise SettingError(
                    f"{name} is for poses of a gripper of two fingers; give one with --hand"
                )
        for text in self.at:
            parse_lengths("at", text)

    @property
    def posed_hand(self) -> Hand | None:
        """The hand, if it has poses for grasps of so many fingers."""
        hand = self.reach.hand
        return hand if hand is not None and self.model.fingers in hand.fingers else None


@dataclass(frozen=True)
class Check(Searching):
    """Diagnose meshes: unit, holes, orientation, bodies, self-intersections, noise.

    With the options of label it reports whether labels can be trusted. Exit code 0: for all
    meshes, at least with care; 1: not for all meshes, or some cannot be read.

    Example:
        # Diagnose one mesh
        grasp3d check meshes/mug.glb
        # Diagnose all meshes of a folder, and write a report
        grasp3d check meshes --unit m --max-opening 60mm -o meshes.json
    """

    inputs: Inputs

    output: Annotated[Path | None, Main("report: .json")] = None
    """Report with all results (.json)."""

    json: Annotated[bool, Main("print JSON instead of tables")] = False
    """Print JSON instead of tables."""

    strict: Annotated[bool, Main("exit code 1 also where care is needed")] = field(
        default=False, kw_only=True
    )
    """Exit code 1 also for meshes whose labels can be trusted with care only."""

    mesh: Annotated[MeshOptions, WholeMesh] = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)

    def __post_init__(self) -> None:
        if not self.inputs:
            raise SettingError("no input: name a mesh file, or a folder of meshes")


@dataclass(frozen=True)
class View(Labelling):
    """View an object: rotate it, change friction and resolution, click for reasons.

    Of a labelled file, options with their default are taken from the file.

    Example:
        # Open a window
        grasp3d view meshes/mug.glb
        # Write a picture instead, which needs no display
        grasp3d view meshes/mug.glb --paint max_resolution --screenshot mug.png
    """

    target: Annotated[
        Path,
        POSITIONAL,
        Stated(metavar="PATH"),
        Main("a mesh, a labelled PLY, or the folder of a batch"),
    ]
    """A mesh, a labelled PLY, or the folder of results of `grasp3d batch`."""

    grasps: Annotated[Path | None, Main("poses of a gripper or hand to step through")] = None
    """Poses of a gripper or hand on the mesh, as grasp3d evaluate takes them, instead of its
    labels: it is shown at each, the one to be taken first at the front. Needs --hand."""

    contact_rule: Annotated[ContactRule | None, Group("hand")] = None
    """With --grasps: which contacts the poses make, as in grasp3d evaluate (default: given)."""

    web: Annotated[bool, Main("serve a page for a browser, open no window")] = False
    """Serve a page for a browser instead of opening a window, as where there is no display; only
    this computer can connect."""

    port: Annotated[int, Stated(metavar="PORT")] = 8080
    """Port of the page; if it is in use, the next free one."""

    screenshot: Annotated[Path | None, Main("write a picture instead: .png")] = None
    """Write a picture (.png) instead; needs no display."""

    view: ViewSettings = field(default_factory=ViewSettings)

    load: Load = field(default_factory=Load, kw_only=True)


@dataclass(frozen=True)
class Evaluate(Guarded, GivenPoses):
    """Evaluate given grasps: label, critical friction angle and epsilon of each.

    Each contact is moved to the closest point of the surface. At poses of a gripper its jaws are
    closed on the object.

    Example:
        # Evaluate the grasps in a table, in the unit that it states or else that of the mesh's file
        grasp3d evaluate meshes/mug.glb grasps.csv --friction 0.8
        # Accept contacts up to 5 mm from the surface
        grasp3d evaluate meshes/mug.glb grasps.csv --max-distance 5mm -o evaluated.json
    """

    file: MeshFile

    contacts: Annotated[
        Path,
        POSITIONAL,
        Stated(metavar="CONTACTS"),
        Main("contacts, or poses of a gripper or a hand"),
    ]
    """Contact points in the mesh's frame: CSV or Parquet with columns x1 y1 z1 x2 y2 z2
    ... and one row per grasp, or JSON with a list of grasps, each a list of points [x, y, z]. Or
    poses of a gripper: the files that grasp3d writes; isaac_grasp (.yaml); ACRONYM (.h5); GraspNet
    (.npy); GraspGen and moveit_msgs/Grasp (.json); of hands with joints DexGraspBench and
    DexGraspNet (.npy). They need --hand."""

    output: Annotated[Path | None, Main("results: .csv .parquet .json")] = None
    """Results (.csv, .parquet or .json) (default: NAME_grasps.csv in this folder)."""

    max_distance: Annotated[
        LengthOption, Group("search"), Main("how far contacts may be from the surface")
    ] = None
    """Largest distance of a contact from the surface (default: 1/100 of the object's size)."""

    metrics: Annotated[
        str | None,
        Stated(metavar="all|NAME,NAME"),
        Group("search"),
        Main("quality measures of the literature"),
    ] = None
    """Quality measures of the literature to compute, print and write as further columns: all, or
    names separated by commas, such as min_weight,grasp_isotropy; an unknown name lists them."""

    object_motion: Annotated[ObjectMotion, Group("hand")] = "free"
    """Poses: whether the object gives way to the closing jaws, and settles between them, or does
    not move."""

    object_scale: Annotated[float | None, Group("hand")] = None
    """Factor from the numbers of the object's file to metres, of which the poses are: for files of
    poses on an object at several scales, or that do not state it (default: the one that they
    state)."""

    contact_rule: Annotated[
        ContactRule | None,
        Stated(metavar="RULE"),
        Group("hand"),
        Main("hands with joints: given or closed"),
    ] = None
    """Poses of a hand with joints: which contacts they make. given: the links within the contact
    distance of the surface; closed: the hand closes from its open preshape until its links touch
    (default: given)."""

    contact_distance: Annotated[LengthOption, Group("hand")] = None
    """Poses of a hand with joints: distance from the surface up to which a link touches, a length
    (default: 5mm)."""

    picture: Annotated[Path | None, Main("hands with joints: picture of the best poses")] = None
    """Poses of a hand with joints: picture of the 12 to be taken first (.png, .svg or .pdf)."""

    outcome: OutcomeOption = None
    """Poses: column or key that says whether a grasp held, as grasp3d validate takes it; it is
    written with the results (default: outcome or success, or what the format has)."""

    model: GraspModel = field(default_factory=GraspModel)

    reach: ReachSettings = field(default_factory=ReachSettings)

    load: Load = field(default_factory=Load)

    mesh: MeshOptions = field(default_factory=MeshOptions)


@dataclass(frozen=True)
class Validate(Quiet, Overwriting, Strict, GivenPoses):
    """Compare labels and scores of grasps with what became of them.

    Closes the gripper's jaws at poses of which it is known whether the grasp held, and prints how
    well label, margin, epsilon, grip force and simpler scores predict it: area under the ROC curve,
    paired differences of scores, success within S, M and U, calibration of the margin, and what may
    be the reason where outcomes contradict the label. What files state of gripper (ACRONYM: the
    Franka hand) and mass (also of each grasp, in a column mass) is used unless it is given.

    Example:
        # How well labels predict a robot's log of grasps on one object
        grasp3d validate tried.csv --mesh meshes/mug.glb --hand franka -o validated
        # For rubber pads, with a table of S, M and U at other resolutions
        grasp3d validate tried.csv --mesh meshes/mug.glb --friction 0.8 --sensor-resolutions 0:20:5
    """

    grasps: Annotated[
        tuple[Path, ...], POSITIONAL, Main("poses with outcomes: .csv .h5 .json .yaml")
    ]
    """Files of poses with outcomes: tables (.csv, .parquet) with px py pz qx qy qz qw and a column
    success (or outcome) of 1 or 0, true or false, empty where it was not tried; ACRONYM
    (.h5); GraspGen and the files that grasp3d writes (.json)."""

    output: Annotated[
        Path | None, Stated(metavar="FOLDER"), Main("folder for tables and figures")
    ] = None
    """Folder for tables, as CSV, and figures, as SVG (default: only prints)."""

    mesh_file: Annotated[
        Path | None,
        Stated(name="mesh", metavar="FILE"),
        Group("object"),
        Main("mesh of the object of all grasps"),
    ] = None
    """Mesh of the object of all grasps (default: the one that each file of grasps names, in the
    scale that it states)."""

    meshes: Annotated[
        Path | None,
        Stated(metavar="FOLDER"),
        Group("object"),
        Main("folder of the meshes that the grasps name"),
    ] = None
    """Folder in which these meshes are looked up, by their path, then by their base name (default:
    the folder of each file of grasps)."""

    outcome: Annotated[OutcomeOption, Main("column that says whether a grasp held")] = None
    """Column or key of the files that says whether a grasp held: 1 or 0, true or false, empty: not
    tried (default: outcome or success; in ACRONYM and GraspGen object_in_gripper)."""

    frictions: NumberRanges = ("0.3", "0.5", "1.0")
    """Coefficients of friction of the table of S, M and U."""

    sensor_resolutions: DegreeRanges = ("0", "10", "22.6", "40")
    """Sensor resolutions of that table."""

    statistics: Annotated[
        ValidationSettings, without(ValidationSettings, "frictions", "sensor_resolutions")
    ] = field(default_factory=ValidationSettings)

    model: Annotated[GraspModel, without(GraspModel, "fingers", "method", "extreme_normals")] = (
        field(default_factory=GraspModel)
    )

    reach: ReachSettings = field(default_factory=ReachSettings)

    load: LoadOfJaws = field(default_factory=Load)

    surface: Annotated[MeshOptions, WholeMesh] = field(default_factory=MeshOptions)

    object_motion: Annotated[ObjectMotion, Group("hand")] = "free"
    """Whether objects give way to the closing jaws: they settle between them, or do not move."""

    def __post_init__(self) -> None:
        if not self.grasps:
            raise SettingError("no input: name files of poses with outcomes")


@dataclass(frozen=True)
class Simulate(Guarded, GivenPoses):
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

    file: MeshFile

    output: Annotated[Path | None, Main("table: .csv .parquet; or poses")] = None
    """Table with a row for each grasp (.csv or .parquet), or poses with outcomes in any format that
    has them (default: NAME_simulation.csv in this folder)."""

    grasps: Annotated[Path | None, Group("simulation"), Main("poses of a gripper to simulate")] = (
        None
    )
    """File of poses of a gripper to simulate, in any format that grasp3d evaluate reads (default:
    grasps are drawn from the surface)."""

    hand: Annotated[Hand | None, Group("hand"), Main("gripper of the poses")] = None
    """Name of a preset, or a file, of the gripper of the poses. Of drawn grasps: a gripper with
    round tips, whose radius and limits of the opening are taken (default: tips of --tip-radius)."""

    min_opening: Annotated[LengthOption, Group("hand")] = 0.0
    """Smallest distance between the contacts, a length (default: 0)."""

    max_opening: Annotated[LengthOption, Group("hand"), Main("largest grasp, such as 80mm")] = None
    """Largest distance between the contacts, a length (default: none)."""

    simulation: SimulationSettings = field(default_factory=SimulationSettings)

    model: Annotated[
        GraspModel,
        without(GraspModel, "fingers", "method", "extreme_normals", "edges", "actuation"),
    ] = field(default_factory=GraspModel)

    mesh: Annotated[MeshOptions, WholeMesh] = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)
