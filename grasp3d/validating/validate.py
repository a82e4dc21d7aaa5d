"""LoadResult labels and scores of grasps against their outcomes."""

import math
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from grasp3d.arrays import Ints, locked
from grasp3d.errors import ContactError, SettingError
from grasp3d.grasps.audit import READING, READINGS, explained
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.pose_files.frames import GivenFrame, GivenPose, read_frame
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.closed_jaws import MEANING as CLOSINGS
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.frames import AUTO
from grasp3d.hand.hand_files import GivenHand, given_hand
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene
from grasp3d.mesh import MeshSource, ObjectMesh
from grasp3d.quality.loads import GivenLoad, Load
from grasp3d.settings import GivenModel, GraspModel, MeshOptions
from grasp3d.surface.fields import Array
from grasp3d.system.context import refuse_warnings, report_progress, within
from grasp3d.validating.disagreements import Disagreements
from grasp3d.validating.file_warnings import FileWarnings
from grasp3d.validating.intervals import FEW_OBJECTS
from grasp3d.validating.qualities import compare_objects, compare_scores
from grasp3d.validating.scores import SCORES, results_of, scores_of
from grasp3d.validating.success import calibrate, label_success, labels_at
from grasp3d.validating.tried_grasps import StatedObject, TriedGrasps, check_grasps, stated_object
from grasp3d.validating.validation import ScoredGrasps, ValidatedFile, Validation
from grasp3d.validating.validation_settings import LEAST_RESAMPLES, ValidationSettings

CHUNK = 20_000
"""Poses evaluated at a time; only their scores are kept."""


@dataclass
class Evaluation:
    """Grasps that are evaluated, file by file, and what is kept of them."""

    model: GraspModel
    options: MeshOptions | None
    reach: ReachSettings
    load: Load | None
    object_motion: ObjectMotion
    disagreements: Disagreements
    explain: bool = False
    """Whether poses are read as they fit their object."""
    files: list[ValidatedFile] = field(default_factory=list)
    parts: list[ScoredGrasps] = field(default_factory=list)
    objects: dict[object, int] = field(default_factory=dict)
    models: list[GraspModel] = field(default_factory=list)
    warnings: FileWarnings = field(default_factory=FileWarnings)

    def evaluate(self, tried: TriedGrasps, total: int) -> None:
        """Evaluate the poses of one file, in chunks."""
        if not tried.count:
            self.warnings.add(tried.name, "no outcome is known of its grasps; left out")
            return
        poses, numbers = tried.poses()
        body = stated_object(tried.mesh, poses, self.options, self.load)
        name = body.mesh.report.source
        if self.explain:
            scene = Scene.of(replace(self.reach, hand=tried.hand), body.mesh)
            assert scene is not None
            poses = explained(body.mesh, poses, tried.hand, table=scene.table)
            self.warnings.add(tried.name, f"{READINGS[READING]}: {poses.settings[READING]}", name)
        number, first = self._object(tried, body.mesh), sum(part.size for part in self.parts)
        own: list[ScoredGrasps] = []
        warnings = dict.fromkeys(body.warnings)
        for low in range(0, tried.count, CHUNK):
            rows = np.arange(low, min(low + CHUNK, tried.count))
            with within((first + low) / total, (first + low + len(rows)) / total):
                closed, parts = self._evaluated(poses.take(rows), tried, body, rows)
            # Those of a part are on its load.
            for one in [closed, *(each for each, _ in parts)] if not low else ():
                warnings |= dict.fromkeys(one.warnings)
            for evaluated, part in parts:
                scores = scores_of(evaluated)
                worst, best = evaluated.critical_angle, evaluated.critical_angle_best
                self.disagreements.add(evaluated, scores, first + part)
                own.append(
                    ScoredGrasps(
                        file=np.full(len(part), len(self.files)),
                        grasp=numbers[part],
                        object_number=np.full(len(part), number),
                        held=np.asarray(evaluated.outcome == 1.0),
                        state=evaluated.state,
                        label=evaluated.label,
                        angle_upper=worst,
                        angle_lower=best,
                        scores=scores,
                        columns={**results_of(evaluated), "mass": body.masses[part]},
                    )
                )
        self.parts += own
        count = sum(int(part.closed.sum()) for part in own)
        if not count:
            warnings["at no pose the jaws close on the mesh"] = None
        for line in warnings:
            self.warnings.add(tried.name, line, name)
        known = body.masses[~np.isnan(body.masses)]
        self.files.append(
            ValidatedFile(
                name=tried.name,
                object_number=number,
                object_name=name,
                count=tried.count,
                held=sum(int(part.held.sum()) for part in own),
                not_tried=tried.not_tried,
                not_closed=tried.count - count,
                hand=tried.hand.name,
                hand_from=tried.hand_from,
                mass=(float(known.min()), float(known.max())) if len(known) else None,
                mass_from=body.mass_from,
                center_from=body.center_from,
            )
        )

    def _object(self, tried: TriedGrasps, mesh: ObjectMesh) -> int:
        """Number of an object: one mesh in one size is one object, whatever its mass."""
        source = tried.mesh
        key = str(Path(source).resolve()) if isinstance(source, str | Path) else id(source)
        size = round(mesh.size, 9)
        return self.objects.setdefault((key, size), len(self.objects))

    def _evaluated(
        self, poses: GraspPoses, tried: TriedGrasps, body: StatedObject, rows: Ints
    ) -> tuple[EvaluatedPoses, list[tuple[EvaluatedPoses, Ints]]]:
        """Poses, and those of each load with their rows among all poses of the file."""
        beside = replace(self.reach, hand=tried.hand)
        scene, model = Scene.of(beside, body.mesh), beside.touching(self.model)
        assert scene is not None
        self.models.append(model)
        with within(0.0, 0.5):
            closed = evaluate_grasps(
                body.mesh, poses, model, scene=scene, object_motion=self.object_motion,
                load=body.load,
            )  # fmt: skip
        parts: list[tuple[EvaluatedPoses, Ints]] = []
        done = 0.5
        for part, load in body.parts(rows):
            evaluated = replace(closed.take(part - rows[0]), load=load)
            start, done = done, done + 0.5 * len(part) / len(rows)
            with within(start, start + 0.8 * (done - start)):
                _ = evaluated.epsilon_range
            with within(start + 0.8 * (done - start), done):
                _ = evaluated.load_result
            parts.append((evaluated, part))
        return closed, parts

    def check(self) -> None:
        """Refuse grasps of which none closes.

        Raises:
            ContactError: At no pose the jaws close on the mesh.
        """
        counts = Counter(Closing(code) for part in self.parts for code in part.state.tolist())
        if counts[Closing.CLOSED]:
            return
        states = "; ".join(f"{CLOSINGS[state]}: {count}" for state, count in sorted(counts.items()))
        reasons = "; ".join(self.warnings.lines()[:3])
        raise ContactError(
            f"at none of the {counts.total()} poses the jaws close on the mesh "
            f"({states}): check gripper, unit and frame of the poses; {reasons}"
        )


EVALUATED = 0.9
"""Fraction of the work after which all poses are evaluated."""

Grasps = str | Path | GraspPoses | Sequence[str | Path | GraspPoses]

MOST_DRAWN = 100_000_000
"""Most grasps that all resamples draw, which takes one and a half minutes."""


FEW_OUTCOMES = 10
"""Grasps that held, or failed, below which a warning says so."""


def validate_grasps(
    grasps: Grasps,
    model: GivenModel = None,
    *,
    mesh: MeshSource | None = None,
    meshes: str | Path | None = None,
    options: MeshOptions | None = None,
    hand: GivenHand = None,
    reach: ReachSettings | None = None,
    object_motion: ObjectMotion = "free",
    load: GivenLoad = None,
    settings: ValidationSettings | None = None,
    outcome: str | None = None,
    object_pose: GivenPose | None = None,
    frame: GivenFrame | None = None,
) -> Validation:
    """Hold labels and scores of grasps against what became of them.

    The jaws are closed at each pose that has an outcome (`GraspPoses.outcome`), as by
    `evaluate_grasps`, and critical friction angle, margin, epsilon, grip force, label, reach and
    simpler scores are compared with the outcomes. Every score counts in a direction that is fixed
    beforehand (`SCORES`). Nothing is fitted to the outcomes but the thresholds of `calibration`.

    Args:
        grasps: Files of poses with outcomes, or `GraspPoses`, one or several.
        model: Friction and sensor resolution [rad], of method exact, with all fingers alike; None:
            the defaults. Where it has the default resolution, that which the gripper states is
            used, if any.
        mesh: The mesh of all grasps; None: the file that each file of grasps names, with the scale
            that it states.
        meshes: Folder in which these meshes are looked up, besides that of each file of grasps.
        options: How meshes are read.
        hand: The gripper; None: that of `reach`, else that which each file states (a known
            name, or the description in files of this project), else for ACRONYM's files the
            Franka hand.
        reach: What the objects stand on, and the allowed approach directions.
        object_motion: free: objects settle between the jaws; fixed: they do not move.
        load: What each grasp must hold; None, or without a mass: the mass and the centre of mass
            that a file states, as ACRONYM's do.
        settings: Grid of the labels, bins, resamples and seed; None: the defaults.
        outcome: Column or key of the files that says whether a grasp held, 1 or 0, true or false;
            of poses in memory `score` or one of their columns. None: the outcomes of the format or
            of the poses.
        object_pose: Pose of the object in the frame of their poses, as `read_grasps` takes it.
        frame: Frame of the gripper in which the files have the poses, as `read_grasps` takes it;
            'auto': the one in which most poses close on the object, if it wins clearly; see
            `PoseReading`. None: the one that each file or its format states.

    Raises:
        ContactError: A file is missing or damaged, no outcome is known, a value is none, or no jaws
            close.
        MeshError: A mesh is not found, or is none.
        SettingError: The gripper or the unit of a mesh is not known, or a setting is outside its
            range.

    Example:
        Ten grasps of a box, some of which miss it:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import GraspPoses
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (10, 1, 1))
        >>> poses[:, 1, 3] = np.linspace(0.0, 0.04, 10)
        >>> tried = GraspPoses(poses=poses, outcome=[1, 1, 1, 1, 1, 0, 0, 0, 0, 0], unit="m")
        >>> franka = grasp3d.read_hand("franka")
        >>> validation = grasp3d.validate_grasps(tried, mesh=box, hand=franka)
        >>> validation.grasps.size, int(validation.grasps.closed.sum())
        (10, 7)
        >>> print(f"{validation.quality('margin').roc_auc:.2f}")
        0.80
    """
    is_auto = isinstance(frame, str) and frame == AUTO
    settings, reach = settings or ValidationSettings(), reach or ReachSettings()
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
        load=load,
        object_pose=object_pose,
        frame=None if is_auto or frame is None else read_frame(frame),
    )
    worst = Disagreements(settings.worst)
    evaluation = Evaluation(model, options, reach, load, object_motion, worst, explain=is_auto)
    with within(0.0, EVALUATED):
        for source in tried:
            evaluation.evaluate(source, sum(each.count for each in tried))
    evaluation.check()
    with within(EVALUATED, 1.0):
        validation = replace(_compared(evaluation, settings), outcome=outcome)
    refuse_warnings(validation.warnings)
    report_progress(1.0)
    return validation


def _compared(evaluation: Evaluation, settings: ValidationSettings) -> Validation:
    """Compare the scores of evaluated grasps with their outcomes."""
    grasps, model = _joined(evaluation.parts), evaluation.models[0]
    by_object, resamples = len(evaluation.objects) > 1, _resamples(grasps.size, settings.resamples)
    scores = [score for score in SCORES if score.name in grasps.scores]
    qualities, differences = compare_scores(
        scores, grasps.scores, grasps.held,
        grasps.object_number if by_object else np.arange(grasps.size),
        resamples=resamples, seed=settings.seed,
    )  # fmt: skip
    return Validation(
        files=tuple(evaluation.files),
        grasps=grasps,
        model=model,
        settings=settings,
        qualities=qualities,
        differences=differences,
        by_objects=compare_objects(scores, grasps.scores, grasps.held, grasps.object_number),
        by_object=by_object,
        resamples=resamples,
        labels=tuple(
            label_success(
                grasps.held,
                labels_at(grasps.angle_upper, grasps.angle_lower, model, friction, resolution),
                friction,
                resolution,
            )
            for friction in settings.frictions
            for resolution in settings.sensor_resolutions
        ),
        calibration=calibrate(
            grasps.held, grasps.scores["margin"], bins=settings.bins, target=settings.target
        ),
        disagreements=evaluation.disagreements.all(),
        reasons=evaluation.disagreements.reasons(),
        warnings=(*evaluation.warnings.lines(), *_warnings(evaluation, grasps)),
    )


def _warnings(evaluation: Evaluation, grasps: ScoredGrasps) -> Iterator[str]:
    """Sentences on outcomes and objects that leave little to say."""
    names = ", ".join(one.name for one in evaluation.files[:5])
    if grasps.one_sided:
        became = "held" if grasps.held.all() else "failed"
        yield f"{names}: all {grasps.size} grasps {became}, so no score can be ranked"
    least = min(int(grasps.held.sum()), int((~grasps.held).sum()))
    if 0 < least < FEW_OUTCOMES:
        rare = "held" if grasps.held.sum() == least else "failed"
        yield (
            f"only {least} of {grasps.size} grasps {rare}: scores, intervals and thresholds of so "
            "few say little about other grasps"
        )
    if 1 < len(evaluation.objects) < FEW_OBJECTS:
        yield (
            f"intervals by object are of {len(evaluation.objects)} objects only, too few to know "
            "how much objects differ: they are too narrow"
        )
    heavy = [one.name for one in evaluation.files if one.mass is not None]
    if 0 < len(heavy) < len(evaluation.files):
        lack = "have the worst forces" if evaluation.load is None else "are loaded with 1 kg"
        yield (
            f"the mass is known in {len(heavy)} of {len(evaluation.files)} files only: grasps of "
            f"the others {lack}"
        )
    if len({one.sensor_resolution for one in evaluation.models}) > 1:
        yield "the grippers state different sensor resolutions: labels and margins are of each"


def _resamples(size: int, most: int) -> int:
    """Resamples for so many grasps: so many that all together draw few enough of them."""
    return max(min(most, MOST_DRAWN // max(size, 1)), LEAST_RESAMPLES)


def _joined(parts: Sequence[ScoredGrasps]) -> ScoredGrasps:
    """All grasps in the order of their files; what some files lack is nan or empty there."""
    order = np.lexsort([np.concatenate([getattr(part, name) for part in parts])
                        for name in ("grasp", "file")])  # fmt: skip

    def joined(arrays: Iterable[Array]) -> Array:
        return locked(np.concatenate(list(arrays))[order])

    def mapped(tables: Sequence[Mapping[str, Array]], names: Iterable[str]) -> dict[str, Array]:
        found = {}
        for name in names:
            known = [table[name].dtype.kind for table in tables if name in table]
            missing = "" if "U" in known else math.nan
            if known:
                found[name] = joined(
                    table.get(name, np.full(part.size, missing))
                    for table, part in zip(tables, parts, strict=True)
                )
        return found

    scores = mapped([part.scores for part in parts], (score.name for score in SCORES))
    names = dict.fromkeys(name for part in parts for name in part.columns)
    columns = mapped([part.columns for part in parts], names)
    others = vars(parts[0]).keys() - {"scores", "columns"}
    return ScoredGrasps(
        scores=scores,
        columns=columns,
        **{name: joined(getattr(part, name) for part in parts) for name in others},
    )
