"""Simulating given poses of a gripper: which of them hold the object?"""

from dataclasses import replace

import numpy as np

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.pose_evaluation import evaluate_poses, in_stated_scale
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.metres import metres_per_unit
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.mesh import MeshSource, load_mesh
from grasp3d.physics.engine import mujoco_module
from grasp3d.physics.hand import Tips
from grasp3d.physics.jobs import Stage, divided, simulate_attempts
from grasp3d.physics.pulling import Attempt, Fate
from grasp3d.physics.simulate import simulated_object
from grasp3d.physics.simulation_settings import SimulationSettings
from grasp3d.settings import GraspModel
from grasp3d.settings.lengths import settings_in_unit
from grasp3d.settings.parsing import plain_values
from grasp3d.system.progress import Progress, ignore
from grasp3d.system.steps import begin_step

LENGTHS = ("slip", "shift")
"""Numbers of an outcome that become columns, with an `_m` in their names: they are in metres."""


def simulate_poses(
    mesh: MeshSource,
    poses: GraspPoses,
    model: GraspModel | None = None,
    *,
    hand: ParallelGripper,
    simulation: SimulationSettings | None = None,
    cluster: ClusterSettings | None = None,
    progress: Progress | None = None,
) -> GraspPoses:
    """Close a gripper at given poses in MuJoCo, and pull at the object that it holds.

    The object floats and may move between the tips while they close; then it is pulled by its
    weight at its centre of mass along each axis of the gripper. It is held where it stays within
    the limits of shift and turn of where it was after the squeeze. The flat pads or round tips of
    the gripper are simulated, not its fingers and palm: `reachable` is whether these collide.

    Args:
        mesh: The object, whose unit is known or stated by the poses.
        poses: The poses.
        model: Friction, torsion radius, and what labels depend on; None: as in `evaluate_poses`.
        hand: The gripper.
        simulation: Forces, times, limits and convex parts; None: the defaults. `count`,
            `tip_radius`, `pulled` and `part_angle` have no effect.
        cluster: Which processes simulate; None: one for each processor of this machine.
        progress: Called with the fraction of the work done, from 0 to 1.

    Returns:
        The poses with the labels and numbers of `evaluate_poses`, their simulated `outcome`, which
        files hold as `success`, and the columns `fate`, `pulls_held`, `slip_m`, `shift_m` [m],
        `turn` and `spin` [rad].

    Raises:
        MeshError: It is no mesh.
        SettingError: As in `evaluate_poses`; or MuJoCo or CoACD is not installed.
        GraspError: Every simulation failed.

    Example:
        A box between the pads of a gripper, and a pose beside it:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.batch import ClusterSettings
        >>> from grasp3d.grasps import GraspPoses
        >>> from grasp3d.physics import SimulationSettings, simulate_poses
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> from_above = np.diag([1.0, -1.0, -1.0, 1.0])
        >>> beside = from_above + [[0, 0, 0, 0], [0, 0, 0, 0.1], [0, 0, 0, 0], [0, 0, 0, 0]]
        >>> tried = simulate_poses(
        ...     box, GraspPoses(poses=[from_above, beside]),
        ...     hand=grasp3d.ParallelGripper.preset("franka"),
        ...     simulation=SimulationSettings(pull_time=0.1), cluster=ClusterSettings(workers=0),
        ... )
        >>> tried.outcome.tolist(), tried.columns["fate"].tolist()
        ([1.0, 0.0], ['held', 'missed'])
    """
    mujoco_module()
    surface = in_stated_scale(load_mesh(mesh), poses)
    scale, processes = metres_per_unit(surface), cluster or ClusterSettings()
    (settings,) = settings_in_unit("m", simulation or SimulationSettings())
    settings = replace(settings, pulled="center_of_mass")
    found = evaluate_poses(surface, poses, model, hand=hand, threads=1)
    begin_step("dividing the object into convex parts")
    parts = divided(surface, settings, processes)
    begin_step("simulating grasps")
    stage = Stage(
        simulated_object(surface, parts, scale), _tips(hand, found.model, scale), settings
    )
    attempts = _attempts(found, stage.tips, scale)
    outcomes, _ = simulate_attempts(attempts, stage, processes, progress or ignore)
    table = {
        "fate": np.array([str(one.fate) for one in outcomes]),
        "pulls_held": np.array([one.pulls_held for one in outcomes]),
        **{f"{name}_m": np.array([getattr(one, name) for one in outcomes]) for name in LENGTHS},
        **{name: np.array([getattr(one, name) for one in outcomes]) for name in ("turn", "spin")},
    }
    evaluated = found.to_poses()
    known = {
        f"simulation_{name}": value
        for name, value in plain_values(settings).items()
        if name != "pulled"
    }
    return replace(
        evaluated,
        outcome=np.array([_outcome(one.fate, held=one.held) for one in outcomes]),
        columns={**evaluated.columns, **table},
        settings={**evaluated.settings, **known},
    )


def _tips(hand: ParallelGripper, model: GraspModel, scale: float) -> Tips:
    """The gripper's tips, in metres."""
    pad = (hand.finger_thickness, hand.pad_width, hand.pad_height)
    return Tips(
        hand.tip_radius,
        model.friction,
        model.torsion_radius * scale,
        (0.0, 0.0, 0.0) if hand.round_tips else pad,
    )


def _attempts(found: EvaluatedPoses, tips: Tips, scale: float) -> list[Attempt]:
    """The attempts, from the opening with which the gripper comes."""
    poses = np.array(found.poses.poses)
    poses[:, :3, 3] *= scale
    stroke = found.hand.max_opening
    openings = np.nan_to_num(found.poses.pregrasp_opening * scale, nan=stroke)
    return [
        Attempt(
            pose,
            float(min(opening, stroke)),
            found.mesh.center_mass * scale,
            np.full(2, tips.friction),
            may_move=True,
        )
        for pose, opening in zip(poses, openings, strict=True)
    ]


def _outcome(fate: Fate, *, held: bool) -> float:
    """1: the object was held, 0: it was not, nan: the simulation says nothing."""
    return np.nan if fate is Fate.BROKEN else float(held)
