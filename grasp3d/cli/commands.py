"""The options of each command."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from grasp3d.batch.batch_settings import Surfaces
from grasp3d.cli.options import (
    ARGUMENT,
    FOLDER,
    GivenPoses,
    Guarded,
    Labelling,
    LengthOption,
    LoadOfJaws,
    ManyMeshes,
    OneMesh,
    Overwriting,
    Parser,
    PoseFormat,
    Quiet,
    Searching,
    Strict,
    WholeMesh,
    Without,
)
from grasp3d.errors import SettingError
from grasp3d.hand.choices import ContactRule
from grasp3d.hand.frames import GripperFrame, ObjectPose
from grasp3d.hand.hand import Hand as AnyHand
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.jobs.cluster_settings import ClusterSettings
from grasp3d.outcomes.simulation_settings import SimulationSettings
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import DEGREE, GraspModel, MeshOptions, Radians, Sampling
from grasp3d.settings.grasp_model import friction_interval
from grasp3d.settings.units import Metres, parse_lengths

ModelOfJaws = Annotated[GraspModel, Without(["fingers", "method"])]
"""Model of grasps between two jaws."""


@dataclass(frozen=True)
class Batch(Labelling, ManyMeshes):
    """Label every mesh of a library, and write tables and a report.

    It resumes an earlier run of the same command: meshes whose content and settings are unchanged
    are not labelled again.

    Example:
        # Label all meshes of a folder
        grasp3d batch meshes -o results
        # Only GLB files, which state their unit, with two processes
        grasp3d batch 'meshes/*.glb' -o results_glb --max-opening 80mm --workers 2
    """

    output: Annotated[str, Parser("FOLDER")]
    """Folder for the results: labels/, surfaces/ and report/; also on an object store."""

    cluster: ClusterSettings = field(default_factory=ClusterSettings)

    overwrite: bool = field(default=False, kw_only=True)
    """Remove the results that are in the folder, and label all meshes again."""

    surfaces: Surfaces = "auto"
    """How labelled surfaces are stored: ply, a file per mesh; tar, an archive of NPZ files for a
    few hundred meshes; none; auto: ply, or tar above 1,000 meshes."""

    part: Annotated[str | None, Parser("I/N")] = None
    """Label only the I-th of N parts of the meshes. Parts may run at the same time, on machines
    that share the folder."""

    best: int = 5
    """Best distinct grasps in the row of each mesh; 0: none, and no verdict, which saves time."""

    more_hands: tuple[AnyHand, ...] = ()
    """Further hands, beside that of --hand: each mesh is labelled for every hand. Rows and files
    are then named after hand and mesh, such as franka/mug.stl."""


@dataclass(frozen=True)
class Sweep(Guarded, ManyMeshes):
    """Compute area fractions of S, M and U over friction and sensor resolution.

    Also prints the sensor resolution that is required for given area fractions of S. Each mesh is
    labelled once; of several meshes the mean is added. Writes a table and a figure.

    Example:
        # The circle of the paper and a mug
        grasp3d sweep circle meshes/mug.glb --friction 0.5
        # How fine a sensor half of a folder's surfaces require
        grasp3d sweep 'meshes/*.glb' --friction 0.5 --fraction 0.5 --max-opening 80mm -o glb.csv
    """

    inputs: Annotated[tuple[str, ...], ARGUMENT, Parser("PATH|SHAPE")]
    """Meshes, folders and shapes, to be given before the options: mesh files, folders, which are
    searched recursively, globs in quotes such as 'lib/**/*.stl', tables of meshes (.csv, .parquet);
    also on an object store (s3://BUCKET/FOLDER). Shapes in closed form with one finger
    fixed: circle, square (in the middle of a side) and sphere; ./circle is a file or folder. Shapes
    have two fingers."""

    output: Path | None = None
    """Table (.csv or .parquet), beside which a figure of the same name with the suffix .svg is
    written (default: NAME_sweep.csv in this folder, sweep.csv for several targets)."""

    friction: Annotated[tuple[str, ...], Parser("NUMBER|FROM:TO:STEP")] = ("0.2", "0.5", "1.0")
    """Coulomb coefficients of friction between fingertip and object, above 0."""

    sensor_resolution: Annotated[tuple[str, ...], Parser("DEGREES|FROM:TO:STEP")] = (
        "0:60:1", "22.6",
    )  # fmt: skip
    """Resolutions of the fingertips' sensors: the angle between the two most different normals that
    they cannot tell apart. One value or more, in degrees, and ranges that include both ends."""

    fraction: tuple[float, ...] = (0.5, 0.9)
    """Area fractions of S, above 0 and at most 1. For each the required sensor resolution is
    printed: at any smaller one at least this fraction of the surface is S."""

    fingers: int = 2
    """Number of fingers, from 2 to 5."""

    sampling: Sampling = field(default_factory=Sampling)

    reach: Annotated[ReachSettings, Without(["pose_error"])] = field(default_factory=ReachSettings)

    mesh: MeshOptions = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)

    def __post_init__(self) -> None:
        for fraction in self.fraction:
            if not 0.0 < fraction <= 1.0:
                raise SettingError(f"each fraction must be above 0 and at most 1; got {fraction:g}")


@dataclass(frozen=True)
class Label(Labelling, OneMesh):
    """Label one mesh: print area fractions of S, M and U, write the labelled mesh.

    Example:
        # Label a mug for a gripper that opens 60 mm
        grasp3d label meshes/mug.glb --max-opening 60mm
        # The best grasps of three fingers, for a mesh whose file states no unit
        grasp3d label meshes/box.obj --unit m --fingers 3 --max-opening 12cm --best 4
    """

    output: Path | None = None
    """Labelled file (.ply, .glb, .npz, .vtp or .parquet) (default: NAME_labeled.ply in this
    folder)."""

    best: int | None = None
    """Number of best distinct grasps to print, and to write to a file with a picture (.png) of the
    same name beside it."""

    grasps: Path | None = None
    """File for the grasps of --best (.json, .csv, .parquet; with a gripper, that of any format of
    poses) (default: NAME_grasps.json in the folder of the labelled file)."""

    grasps_format: Annotated[str | None, PoseFormat] = None
    """With a gripper: format of that file, if several formats share its suffix (default: the main
    one)."""

    object_pose: ObjectPose | None = None
    """With a gripper: pose of the object in your robot's frame, and the poses in that file are then
    in it, too: x,y,z,yaw in metres and degrees, x,y,z,qx,qy,qz,qw, or a file of it (default: the
    poses are in the mesh's frame)."""

    frame: GripperFrame | None = None
    """Frame of the poses in that file: a name, such as graspgen, or a file, as grasp3d evaluate
    takes it (default: that of the format)."""

    at: Annotated[tuple[str, ...], Parser("X,Y,Z")] = ()
    """Also print the label, the grasp and the reason at the vertices nearest to these points of the
    surface."""

    def __post_init__(self) -> None:
        if self.best is not None and self.best < 1:
            raise SettingError(f"best must be at least 1; got {self.best}")
        for name in ("grasps", "grasps_format", "object_pose", "frame"):
            if getattr(self, name) is None:
                continue
            if self.best is None:
                raise SettingError(f"{name} needs the number of best grasps: give --best")
            if name != "grasps" and self.posed_hand is None:
                raise SettingError(
                    f"{name} is for poses of a gripper of two fingers; give one with --hand"
                )
        for text in self.at:
            parse_lengths("at", text)

    @property
    def posed_hand(self) -> AnyHand | None:
        """The hand, if it has poses for grasps with this number of fingers."""
        hand = self.reach.hand
        return hand if hand is not None and self.model.fingers in hand.fingers else None


@dataclass(frozen=True)
class Check(Searching, ManyMeshes):
    """Diagnose meshes: unit, holes, orientation, bodies, self-intersections, noise.

    It reports whether labels can be trusted. Exit code 0: those of all meshes can, at least with
    care; 1: those of some cannot, or a mesh cannot be read.

    Example:
        # Diagnose one mesh
        grasp3d check meshes/mug.glb
        # Diagnose all meshes of a folder, and write a report
        grasp3d check meshes --unit m --max-opening 60mm -o meshes.json
    """

    output: Path | None = None
    """Report with all results (.json)."""

    mesh: WholeMesh = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)


@dataclass(frozen=True)
class View(Labelling):
    """View an object: rotate it, change friction and resolution, click for reasons.

    A labelled file brings its settings; you may change only friction, resolution and fingers.

    Example:
        # Open a window
        grasp3d view meshes/mug.glb
        # Write a picture instead, which needs no display
        grasp3d view meshes/mug.glb --paint max_resolution --screenshot mug.png
    """

    target: Annotated[Path, ARGUMENT, Parser("PATH", FOLDER.parse)]
    """Mesh, labelled PLY or results of a batch: the folder that `grasp3d batch` wrote."""

    grasps: Path | None = None
    """Poses of a gripper or hand on the mesh, as grasp3d evaluate takes them. The hand is shown at
    each instead of the labels, at the best one first. Needs --hand."""

    web: bool = False
    """Serve a page for a browser instead of opening a window, as where there is no display; only
    this computer can connect."""

    screenshot: Path | None = None
    """Write a picture (.png) instead; needs no display."""

    view: ViewSettings = field(default_factory=ViewSettings)


@dataclass(frozen=True)
class Evaluate(Guarded, GivenPoses, OneMesh):
    """Evaluate given grasps: label, critical friction angle and epsilon of each.

    Each contact is moved to the closest point of the surface. At poses of a gripper its jaws are
    closed on the object.

    Example:
        # Evaluate the grasps in a table, in the unit that it states or else that of the mesh's file
        grasp3d evaluate meshes/mug.glb grasps.csv --friction 0.8
        # Accept contacts up to 5 mm from the surface
        grasp3d evaluate meshes/mug.glb grasps.csv --max-distance 5mm -o evaluated.json
    """

    contacts: Annotated[Path, ARGUMENT]
    """Contacts, or poses of a gripper or hand: contact points in the mesh's frame, as CSV or
    Parquet with columns x1 y1 z1 x2 y2 z2 ... and one row per grasp, or JSON with a list of grasps,
    each a list of points [x, y, z]. Or poses, in one of the formats FORMATS; the format is found
    from the suffix and the content. Poses need --hand."""

    output: Path | None = None
    """Results (.csv, .parquet or .json) (default: NAME_grasps.csv in this folder)."""

    max_distance: LengthOption = None
    """Largest distance of a contact from the surface (default: 1/100 of the object's size)."""

    metrics: str | None = None
    """Quality measures of the literature to compute, print and write as further columns: all, or
    names separated by commas, such as min_weight,grasp_isotropy; any other name lists them."""

    object_scale: float | None = None
    """Factor that converts the coordinates of the object's file to metres. Give it if the poses are
    for an object at several scales, or do not state the scale (default: the one that they
    state)."""

    contact_rule: ContactRule | None = None
    """Contacts of poses of a hand with joints. given: the links within the contact
    distance of the surface; closed: the hand closes from its open preshape until its links touch
    (default: given)."""

    outcome: str | None = None
    """Column or key of poses that says whether a grasp held; it is copied to the results (default:
    outcome or success, or that of the format)."""

    model: GraspModel = field(default_factory=GraspModel)

    reach: ReachSettings = field(default_factory=ReachSettings)

    load: Load = field(default_factory=Load)

    mesh: MeshOptions = field(default_factory=MeshOptions)

    @property
    def of_poses(self) -> dict[str, Any]:
        """What is known of the file of poses."""
        stated = {"outcome": self.outcome, "object_scale": self.object_scale}
        return super().of_poses | stated


@dataclass(frozen=True)
class Validate(Quiet, Overwriting, Strict, GivenPoses):
    """Compare labels and scores of grasps with their outcomes.

    Closes the gripper's jaws at poses with known outcomes, and prints how well label, margin,
    epsilon, grip force and simpler scores predict them: success within S, M and U, area under the
    ROC curve of each score, and the grasps whose outcome contradicts their label. Gripper and mass
    are as the files state (mass also per grasp, in a column mass), unless you give them.

    Example:
        # How well labels predict a robot's log of grasps on one object
        grasp3d validate tried.csv --mesh meshes/mug.glb --hand franka -o validated.csv
        # For rubber pads
        grasp3d validate tried.csv --mesh meshes/mug.glb --friction 0.8
    """

    grasps: Annotated[tuple[Path, ...], ARGUMENT]
    """Files of poses with outcomes: tables (.csv, .parquet) with px py pz qx qy qz qw and a column
    success (or outcome) of 1 or 0, true or false, empty where it was not tried; or another of the
    formats FORMATS that states outcomes."""

    output: Path | None = None
    """Table of all grasps (.csv or .parquet), beside which a figure of the same name with the
    suffix .svg is written (default: only prints)."""

    mesh: Path | None = None
    """Mesh of the object of all grasps (default: the one that each file of grasps names, at the
    scale that it states)."""

    meshes: Annotated[Path | None, FOLDER] = None
    """Folder in which these meshes are looked up, by their path, then by their base name (default:
    the folder of each file of grasps)."""

    outcome: str | None = None
    """Column or key of the files that says whether a grasp held: 1 or 0, true or false, empty: not
    tried (default: outcome or success, or that of the format)."""

    model: ModelOfJaws = field(default_factory=GraspModel)

    reach: ReachSettings = field(default_factory=ReachSettings)

    load: LoadOfJaws = field(default_factory=Load)

    surface: WholeMesh = field(default_factory=MeshOptions)


@dataclass(frozen=True)
class Simulate(Guarded, GivenPoses, OneMesh):
    """Simulate grasps of a gripper in MuJoCo: does the object stay in it?

    The gripper closes at given poses, or at its best ones on the object, which is then pulled by
    its weight in six directions. Needs the extra: pip install 'grasp3d[physics]'.

    Example:
        # Do the best grasps of a gripper on a box hold it?
        grasp3d simulate meshes/box.obj --unit m --hand franka --count 2 --pull-time 0.2
        # At two wrong poses for each, as a robot would reach them
        grasp3d simulate meshes/box.obj --unit m --hand wsg50 --trials 2 --pose-error 2mm -o a.csv
    """

    hand: AnyHand
    """Gripper: the name of a preset, or a file."""

    output: Path | None = None
    """Poses with outcomes (.csv, .parquet, .json, or another format that has them) (default:
    NAME_simulation.csv in this folder)."""

    grasps: Path | None = None
    """File of poses of the gripper to simulate, in any format that grasp3d evaluate reads (default:
    the best grasps on the object, as many as --count)."""

    simulation: SimulationSettings = field(default_factory=SimulationSettings)

    model: ModelOfJaws = field(default_factory=GraspModel)

    mesh: WholeMesh = field(default_factory=MeshOptions)

    cluster: ClusterSettings = field(default_factory=ClusterSettings)


@dataclass(frozen=True)
class Design:
    """Compute the sensor for a friction, or the friction for a sensor.

    With --friction: the coarsest sensor for surely stable grasps. With a sensor, given by
    --receptive-field or --sensor-resolution: the least friction. With both: whether the sensor is
    fine enough for each friction, and with --joints the encoders that the finger needs.

    Example:
        # The coarsest sensor for two frictions
        grasp3d design --friction 0.2 0.5
        # Whether a sensor is fine enough, and the encoders of a finger with two joints
        grasp3d design --friction 0.5 --receptive-field 4mm --joints 2
    """

    friction: tuple[float, ...] = ()
    """Coulomb coefficient of friction between fingertip and object, above 0. One value or more."""

    fingertip_radius: LengthOption = None
    """Radius of a hemispherical fingertip (default: 10mm)."""

    receptive_field: LengthOption = None
    """Sensor: length of the arc on the fingertip within which it cannot distinguish contacts."""

    sensor_resolution: Radians | None = None
    """Sensor, by its resolution in degrees instead."""

    joints: int | None = None
    """Number of revolute joints between palm and fingertip; prints how many counts per revolution,
    after quadrature decoding, their encoders need."""

    def __post_init__(self) -> None:
        for friction in self.friction:
            friction_interval(f"{friction:g}")
        for name in ("fingertip_radius", "receptive_field"):
            length = getattr(self, name)
            if length is not None and not isinstance(length, Metres):
                raise SettingError(f"{name} needs a unit, such as {length:g}mm")
        has_sensor = self.receptive_field is not None or self.sensor_resolution is not None
        if self.receptive_field is not None and self.sensor_resolution is not None:
            raise SettingError(
                "--receptive-field and --sensor-resolution each define the sensor; give one"
            )
        if self.joints is not None and not (has_sensor and self.friction):
            raise SettingError(
                "--joints needs --friction and a sensor: --receptive-field or --sensor-resolution"
            )


@dataclass(frozen=True)
class Hand(Quiet, Overwriting):
    """Print, draw or write as JSON the description of a gripper or a hand with joints.

    Without an argument: list the hands that are known by name.

    Example:
        # Print a gripper, and draw it
        grasp3d hand franka --picture franka.png
        # Draw the frames in which programs give its pose
        grasp3d hand franka --frames frames.png
        # Measure the gripper of a URDF, and draw it with its lengths
        grasp3d hand gripper.urdf -o gripper.json --picture gripper.png
        # Propose the description of a hand with joints, and draw it
        grasp3d hand allegro.urdf -o allegro.json --picture allegro.png
    """

    hand: Annotated[str, ARGUMENT, Parser("[NAME|FILE]")] = ""
    """Name of a preset; or a file: JSON, as this command writes it, URDF (.urdf) or a MuJoCo model
    (.xml, .mjcf)."""

    fingers: Annotated[tuple[str, ...], Parser("LINK")] = ()
    """URDF and MuJoCo: names of the links, or bodies, of the two sliding fingers (default: the only
    two that slide)."""

    palm: str | None = None
    """URDF and MuJoCo: name of the link that is the palm (default: the one that carries the
    fingers)."""

    tcp: LengthOption = None
    """URDF and MuJoCo: distance from the origin of the link that carries the fingers to the tool
    centre point, with a unit, or in m (default: to the middle of the pads)."""

    output: Path | None = None
    """JSON file for the description."""

    picture: Path | None = None
    """Picture of the hand with its frame (.png, .svg or .pdf)."""

    frames: Path | None = None
    """Picture of all frames in which programs give the pose, by name (.png, .svg or .pdf)."""

    def __post_init__(self) -> None:
        options = ("fingers", "palm", "tcp", "output", "picture", "frames")
        names = [name for name in options if getattr(self, name)]
        if names and not self.hand:
            raise SettingError(f"--{names[0]} needs a gripper: a name or a file before the options")


@dataclass(frozen=True)
class Paper(Quiet):
    """Recompute Wan & Howe 2018: figures 4 to 11, their 3-D counterparts, numbers.

    Without options friction and sensor resolutions are those of the paper.

    Example:
        # All figures and numbers
        grasp3d paper -o paper
        # For another friction, with a mesh of your own
        grasp3d paper -o paper_mug --friction 0.5 --object meshes/mug.glb
    """

    output: Annotated[Path, FOLDER]
    """Folder for figure_04 to figure_11 and surface_..., each as .svg and .png, and numbers.md;
    created if it is missing. Figures 4 to 6 are drawings, always for the same tip, friction 1 and
    30 degrees."""

    friction: float = 1.0
    """Coulomb coefficient of friction between fingertip and object, above 0."""

    sensor_resolution: tuple[Radians, ...] = (30.0 * DEGREE, 15.0 * DEGREE)
    """One or two sensor resolutions in degrees, each with a column of the figures."""

    object: Path | None = None
    """Mesh of a real object to scan as well (default: sphere, box and cylinder only)."""
