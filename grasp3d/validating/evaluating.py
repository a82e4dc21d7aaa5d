"""Evaluation of grasps with outcomes, file by file, of which only the scores are kept."""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import ContactError
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.pose_evaluation import in_stated_scale
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.closed_jaws import MEANING as CLOSINGS
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.metres import metres_per_unit
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.mesh.masses import loaded_mesh, mass_of
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions
from grasp3d.system.progress import Progress, within
from grasp3d.validating.disagreements import Disagreements
from grasp3d.validating.scores import scores_of
from grasp3d.validating.tried_grasps import TriedGrasps
from grasp3d.validating.validation import ScoredGrasps, ValidatedFile

CHUNK = 20_000
"""Poses evaluated at a time; only their scores are kept."""

FAR = 2.0
"""Distance of a stated centre of mass from the object's centre, in object sizes, that cannot be
meant."""


@dataclass(frozen=True, eq=False)
class StatedObject:
    """An object as the grasps on it are evaluated."""

    mesh: ObjectMesh
    load: Load | None
    """What each grasp must hold; None: the mass is not known, and no load was given."""
    mass: float | None
    """[kg]; None: not known."""
    mass_from: str
    """given, file or empty."""
    center_from: str
    """given, file, or what the mesh's report says: volume or surface."""


def stated_object(
    source: MeshSource, poses: GraspPoses, options: MeshOptions | None, load: Load | None
) -> StatedObject:
    """Read the mesh of some poses, and take over what their file states of the object.

    What the options state is used first: a mass or density of `load`, a centre of mass of
    `options`.

    Args:
        source: The mesh.
        poses: Poses on it; `object_scale`, and `mass` [kg] and `com` [m] of their settings, as
            ACRONYM states them, in the frame of the scaled mesh.
        options: How the mesh is read.
        load: What each grasp must hold.

    Raises:
        MeshError: It is no mesh.
        SettingError: Its unit is not known, or the load needs what is not known.
        ContactError: The file states an impossible mass or centre of mass.
    """
    mesh = in_stated_scale(load_mesh(source, options), poses)
    metres_per_unit(mesh)
    given = mesh.report.center_mass_from == "given"
    mesh = mesh if given else _with_center(mesh, poses)
    center_from = mesh.report.center_mass_from
    mass, origin = _number(poses.settings.get("mass")), ""
    if load is not None and (load.mass is not None or load.density is not None):
        origin = "given"
    elif mass is not None and center_from != "surface":  # else it is not known what it pulls on
        load, origin = replace(load or Load(), mass=mass), "file"
    mesh, load = loaded_mesh(mesh, load)
    return StatedObject(
        mesh=mesh,
        load=load,
        mass=None if load is None else mass_of(mesh, load),
        mass_from=origin,
        center_from="file" if center_from == "given" and not given else center_from,
    )


def _with_center(mesh: ObjectMesh, poses: GraspPoses) -> ObjectMesh:
    """The mesh with the centre of mass that a file states."""
    stated = poses.settings.get("com")
    if stated is None:
        return mesh
    center = _point(stated) / metres_per_unit(mesh)
    away = float(np.linalg.norm(center - mesh.center)) / mesh.size
    if not away <= FAR:
        raise ContactError(
            f"the centre of mass that the grasps state (object/com) is {away:.3g} object sizes "
            f"away from {mesh.report.source}: is it the right mesh, in the right unit?"
        )
    x, y, z = center.tolist()
    return replace(
        mesh,
        center_mass=locked(center),
        options=replace(mesh.options, center_of_mass=(x, y, z)),
        report=replace(mesh.report, center_mass_from="given"),
    )


def _number(value: Any) -> float | None:
    """A mass above 0. Raises ContactError."""
    if value is None:
        return None
    if isinstance(value, bool) or not isinstance(value, int | float) or not 0.0 < value < 1e9:
        raise ContactError(f"the mass that the grasps state must be above 0 kg; got {value!r}")
    return float(value)


def _point(value: Any) -> Floats:
    """Three finite numbers. Raises ContactError."""
    try:
        point = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        point = np.zeros(0)
    if point.shape != (3,) or not np.isfinite(point).all():
        raise ContactError("the centre of mass that the grasps state must be three numbers")
    return point


@dataclass
class Evaluation:
    """Grasps that are evaluated, file by file, and what is kept of them."""

    model: GraspModel
    options: MeshOptions | None
    reach: ReachSettings
    load: Load | None
    object_motion: ObjectMotion
    threads: int | None
    disagreements: Disagreements
    files: list[ValidatedFile] = field(default_factory=list)
    parts: list[ScoredGrasps] = field(default_factory=list)
    objects: dict[object, int] = field(default_factory=dict)
    models: list[GraspModel] = field(default_factory=list)
    warnings: list[str] = field(default_factory=list)
    states: Counter[Closing] = field(default_factory=Counter)

    def evaluate(self, tried: TriedGrasps, total: int, progress: Progress) -> None:
        """Evaluate the poses of one file, in chunks."""
        if not tried.count:
            self.warnings.append(f"{tried.name}: no outcome is known of its grasps; left out")
            return
        poses, numbers = tried.poses()
        body = stated_object(tried.mesh, poses, self.options, self.load)
        first, file, number = self.size, len(self.files), self._object(tried, body)
        for low in range(0, tried.count, CHUNK):
            chunk = slice(low, min(low + CHUNK, tried.count))
            part = within(progress, (first + chunk.start) / total, (first + chunk.stop) / total)
            found = self._evaluated(poses.take(np.arange(tried.count)[chunk]), tried, body, part)
            if not low:
                self._warn(tried, found)
            self._keep(found, numbers[chunk], file, number)
        self._finish(tried, body, number, file)

    @property
    def size(self) -> int:
        """Grasps so far."""
        return sum(part.size for part in self.parts)

    def _object(self, tried: TriedGrasps, body: StatedObject) -> int:
        """Number of an object: one mesh in one size and of one mass is one object."""
        source = tried.mesh
        key = str(Path(source).resolve()) if isinstance(source, str | Path) else id(source)
        return self.objects.setdefault(
            (key, round(body.mesh.size * metres_per_unit(body.mesh), 9), body.mass),
            len(self.objects),
        )

    def _warn(self, tried: TriedGrasps, found: EvaluatedPoses) -> None:
        """Collect what may make the results wrong, each sentence once."""
        texts = (f"{tried.name}: {line}" for line in found.warnings)
        self.warnings += [text for text in texts if text not in self.warnings]

    def _evaluated(
        self, poses: GraspPoses, tried: TriedGrasps, body: StatedObject, progress: Progress
    ) -> EvaluatedPoses:
        beside = replace(self.reach, hand=tried.hand)
        scene, model = Scene.of(beside, body.mesh), beside.touching(self.model)
        assert scene is not None
        self.models.append(model)
        found = evaluate_grasps(
            body.mesh,
            poses,
            model,
            scene=scene,
            object_motion=self.object_motion,
            load=body.load,
            threads=self.threads,
            progress=within(progress, 0.0, 0.5),
        )
        found.compute_epsilon(within(progress, 0.5, 0.9))
        found.compute_holding(within(progress, 0.9, 1.0))
        return found

    def _keep(self, found: EvaluatedPoses, numbers: Ints, file: int, number: int) -> None:
        """Keep the scores of evaluated poses, and their greatest disagreements."""
        scores = scores_of(found)
        self.disagreements.add(found, scores, self.size)
        worst, best = found.located_angles
        count = found.size
        self.parts.append(
            ScoredGrasps(
                file=np.full(count, file),
                grasp=numbers,
                object_number=np.full(count, number),
                held=np.asarray(found.outcome == 1.0),
                state=found.state,
                label=found.label,
                located_worst=worst,
                located_best=best,
                scores=scores,
            )
        )

    def _finish(self, tried: TriedGrasps, body: StatedObject, number: int, file: int) -> None:
        own = [part for part in self.parts if part.file[0] == file]
        states = Counter(code for part in own for code in part.state.tolist())
        closed = states[int(Closing.CLOSED)]
        self.states.update({Closing(code): count for code, count in states.items()})
        if not closed:
            self.warnings.append(f"{tried.name}: at no pose the jaws close on the mesh")
        self.files.append(
            ValidatedFile(
                name=tried.name,
                object_number=number,
                object_name=body.mesh.report.source,
                count=tried.count,
                held=sum(int(part.held.sum()) for part in own),
                not_tried=tried.not_tried,
                not_closed=tried.count - closed,
                hand=tried.hand.name,
                hand_from=tried.hand_from,
                mass=body.mass,
                mass_from=body.mass_from,
                center_from=body.center_from,
            )
        )

    def check(self) -> None:
        """Refuse grasps of which none closes.

        Raises:
            ContactError: At no pose the jaws close on the mesh.
        """
        if self.states[Closing.CLOSED]:
            return
        states = "; ".join(
            f"{CLOSINGS[state]}: {count}" for state, count in sorted(self.states.items())
        )
        reasons = "; ".join(self.warnings[:3])
        raise ContactError(
            f"at none of the {sum(self.states.values())} poses the jaws close on the mesh "
            f"({states}): check gripper, unit and frame of the poses; {reasons}"
        )
