"""Comparison of the labels and scores of grasps with their outcomes."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from grasp3d.arrays import locked
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats.frames import GivenFrame, GivenPose, read_frame
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.audit import READING, READINGS, explained
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.frames import AUTO
from grasp3d.hand.hand_files import GivenHand, given_hand
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene
from grasp3d.mesh import MeshSource
from grasp3d.outcomes.tried_grasps import TriedGrasps, check_grasps, stated_object
from grasp3d.outcomes.validation import (
    SCORES,
    ScoreQuality,
    ValidatedFile,
    Validation,
    columns_of,
    roc_auc,
)
from grasp3d.quality.loads import GivenLoad, Load
from grasp3d.settings import GivenModel, GraspModel, MeshOptions
from grasp3d.surface.fields import Array
from grasp3d.surface.load_case import input_warnings
from grasp3d.system.context import refuse_warnings, report_progress, within
from grasp3d.system.names import as_unicode

CHUNK = 20_000
"""Number of poses evaluated at a time; only their results are kept."""

Grasps = str | Path | GraspPoses | Sequence[str | Path | GraspPoses]
Table = dict[str, Array]


@dataclass
class Evaluation:
    """Evaluation of grasps, file by file, and the results that are kept."""

    model: GraspModel
    options: MeshOptions | None
    reach: ReachSettings
    load: Load | None
    object_motion: ObjectMotion | None
    explain: bool
    """Whether the frame of the poses is chosen by how well they fit their object."""
    files: list[ValidatedFile] = field(default_factory=list)
    tables: list[Table] = field(default_factory=list)
    objects: dict[object, int] = field(default_factory=dict)
    said: dict[str, dict[str, None]] = field(default_factory=dict)
    """Warnings, each with the names of the files that it applies to."""

    def evaluate(self, tried: TriedGrasps) -> None:
        """Evaluate the poses of one file.

        Raises:
            ContactError: The file states an impossible mass or centre of mass.
        """
        poses, count, source = tried.poses, tried.poses.count, tried.mesh
        if not count:
            self._say(tried, ["no outcome is known of its grasps; left out"])
            return
        try:
            body = stated_object(source, poses, self.options, self.load)
        except ContactError as error:
            raise ContactError(f"{tried.name}: {error}") from error
        mesh, beside = body.mesh, replace(self.reach, hand=tried.hand)
        scene, model = Scene.of(beside, mesh), beside.touching(self.model)
        assert scene is not None
        key = Path(source).resolve() if isinstance(source, str | Path) else id(source)
        number = self.objects.setdefault((key, round(mesh.size, 9)), len(self.objects) + 1)
        if self.explain:
            poses = explained(mesh, poses, tried.hand, table=scene.table)
            self._say(tried, [f"{READINGS[READING]}: {poses.settings[READING]}"])
        for rows in np.array_split(np.arange(count), math.ceil(count / CHUNK)):
            with within(rows[0] / count, (rows[-1] + 1) / count):
                closed = evaluate_grasps(
                    mesh, poses.take(rows), model, scene=scene, object_motion=self.object_motion,
                    load=body.load,
                )  # fmt: skip
                self._say(tried, closed.warnings if rows[0] == 0 else ())
                for part, load in body.parts(rows):
                    self._say(tried, input_warnings(mesh, scene, load, model, None))
                    found = closed.take(part - rows[0]).using(load=load)
                    self.tables.append({
                        "file": np.full(len(part), len(self.files)),
                        "object": np.full(len(part), number),
                        **columns_of(found),
                        "grasp": tried.numbers[part],
                        "mass": body.masses[part],
                    })  # fmt: skip
        hand = f"gripper {tried.hand.name}, {tried.hand_from}"
        sources = f"{hand}; {body.sources}; poses in {tried.poses.frame_words}"
        self.files.append(ValidatedFile(tried.name, number, model, count, tried.not_tried, sources))

    def _say(self, tried: TriedGrasps, lines: Sequence[str]) -> None:
        for line in lines:
            self.said.setdefault(line, {})[tried.name] = None

    def warnings(self) -> list[str]:
        """Reasons why the results may be wrong, each sentence once."""
        return [
            f"{name}{f' and {len(others)} more' if others else ''}: {line}"
            for line, (name, *others) in self.said.items()
        ]


def validate_grasps(
    grasps: Grasps,
    model: GivenModel = None,
    *,
    mesh: MeshSource | None = None,
    meshes: str | Path | None = None,
    options: MeshOptions | None = None,
    hand: GivenHand = None,
    reach: ReachSettings | None = None,
    object_motion: ObjectMotion | None = None,
    load: GivenLoad = None,
    outcome: str | None = None,
    object_pose: GivenPose | None = None,
    frame: GivenFrame | None = None,
) -> Validation:
    """Compare labels and scores of grasps with their outcomes.

    The jaws close at each pose that has an outcome (`GraspPoses.outcome`), as in `evaluate_grasps`.
    Critical friction angle, margin, epsilon, grip force, label, reach and simpler scores are then
    compared with the outcomes. The direction in which each score counts is fixed beforehand
    (`SCORES`), and nothing is fitted to the outcomes.

    Args:
        grasps: Files of poses with outcomes, or `GraspPoses`, one or several.
        model: Friction and sensor resolution [rad], of method exact, with all fingers alike; None:
            the defaults. The default resolution gives way to that of the gripper, if it states one.
        mesh: The mesh of all grasps; None: the file that each file of grasps names, with the scale
            that it states.
        meshes: Folder in which these meshes are looked up, besides the folder of each file.
        options: How meshes are read.
        hand: The gripper; None: that of `reach`, else the one that each file states (a known name,
            or the description in files of this project).
        reach: What the objects stand on, and the allowed approach directions.
        object_motion: For grippers. free, or None: objects settle between the jaws; fixed: they do
            not move.
        load: What each grasp must hold; None, or without a mass: the mass and the centre of mass
            that a file states.
        outcome: Column or key of the files that says whether a grasp held, 1 or 0, true or false;
            for poses in memory `score` or one of their columns. None: the outcomes of the format or
            of the poses.
        object_pose: Pose of the object in the frame of the poses, as `read_grasps` takes it.
        frame: Frame of the gripper in which the files have the poses, as `read_grasps` takes it;
            'auto': the one in which most poses close on the object, if it wins clearly; see
            `PoseReading`. None: the one that each file or its format states.

    Raises:
        ContactError: A file is missing or damaged, no outcome is known, an outcome is invalid, or
            no hand closes.
        MeshError: A mesh file is not found, or is not a mesh.
        SettingError: The gripper or the unit of a mesh is not known, or a setting is outside its
            range.

    Example:
        Ten grasps of a box, some of which miss it:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.formats import GraspPoses
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (10, 1, 1))
        >>> poses[:, 1, 3] = np.linspace(0.0, 0.04, 10)
        >>> tried = GraspPoses(poses=poses, outcome=[1, 1, 1, 1, 1, 0, 0, 0, 0, 0], unit="m")
        >>> franka = grasp3d.read_hand("franka")
        >>> validation = grasp3d.validate_grasps(tried, mesh=box, hand=franka)
        >>> validation.size, validation.rates[grasp3d.Label.S].count
        (10, 7)
        >>> print(f"{validation.quality('margin').roc_auc:.2f}")
        0.80
    """
    is_auto = isinstance(frame, str) and frame == AUTO
    reach = reach or ReachSettings()
    model, load = GraspModel.given("model", model) or GraspModel(), Load.given("load", load)
    if model.method != "exact":
        raise SettingError(
            "outcomes are compared with margins, which method extremes has not; use the method "
            "exact"
        )
    tried = check_grasps(
        [grasps] if isinstance(grasps, str | Path | GraspPoses) else list(grasps),
        mesh=mesh,
        meshes=None if meshes is None else Path(meshes),
        hand=given_hand(hand) or reach.hand,
        outcome=outcome,
        object_pose=object_pose,
        frame=None if is_auto or frame is None else read_frame(frame),
    )
    evaluation = Evaluation(model, options, reach, load, object_motion, explain=is_auto)
    for number, source in enumerate(tried):
        with within(number / len(tried), (number + 1) / len(tried)):
            evaluation.evaluate(source)
    validation = replace(_compared(evaluation), outcome=outcome)
    refuse_warnings(validation.warnings)
    report_progress(1.0)
    return validation


def _compared(evaluation: Evaluation) -> Validation:
    """Compare the scores of evaluated grasps with their outcomes.

    Raises:
        ContactError: The hand closes on the mesh at no pose.
    """
    columns, warnings = _joined(evaluation.tables), evaluation.warnings()
    order = np.lexsort((columns["grasp"], columns["file"]))
    names = [as_unicode(one.name) for one in evaluation.files]
    columns["file"] = np.array(names)[columns["file"]]
    states = Counter(columns["closing"].tolist())
    if not states["closed"]:
        found = "; ".join(f"{state}: {count}" for state, count in states.most_common())
        raise ContactError(
            f"at none of the {len(order)} poses the hand closes on the mesh ({found}): check "
            f"hand, unit and frame of the poses; {'; '.join(warnings[:3])}"
        )
    columns = {name: locked(values[order]) for name, values in columns.items()}
    result = Validation(tuple(evaluation.files), columns, (), ())
    if result.held.all() or not result.held.any():
        became = "held" if result.held.all() else "failed"
        warnings.append(f"all grasps {became}, so no score can be ranked")
    clusters = columns["object"] if result.objects > 1 else np.arange(result.size)
    qualities = [
        ScoreQuality(score, *roc_auc(result.held, result.ranked(score), clusters))
        for score in SCORES
        if score.name in columns
    ]
    return replace(result, qualities=tuple(qualities), warnings=tuple(warnings))


def _joined(tables: Sequence[Table]) -> Table:
    """Stack tables; columns that some of them lack are nan or empty there."""
    joined = {}
    for name in dict.fromkeys(name for table in tables for name in table):
        kinds = {table[name].dtype.kind for table in tables if name in table}
        missing = "" if "O" in kinds else math.nan
        parts = [table.get(name, np.full(len(table["file"]), missing)) for table in tables]
        joined[name] = np.concatenate(parts)
    return joined
