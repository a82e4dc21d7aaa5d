"""Labelling of a surface: the search for the best grasp through every vertex, and the scan.

In a scan all fingers but one are fixed (Wan & Howe 2018, Sec. III-B).
"""

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.search.antipodal_candidates import scan
from grasp3d.arrays import ArrayLike, Floats, used_indices
from grasp3d.errors import SettingError
from grasp3d.hand.hand_files import GivenHand, given_hand
from grasp3d.hand.jaws import IN_METRES
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import Approach, GivenTable
from grasp3d.mesh import MeshSource, ObjectMesh, load_mesh
from grasp3d.mesh.plausible_lengths import refuse_lengths
from grasp3d.mesh.preparing import prepare
from grasp3d.mesh.surface_points import SurfacePoints, nearest_surface_points
from grasp3d.quality.loads import GivenLoad, Load
from grasp3d.settings import (
    GivenModel,
    GivenSampling,
    GraspModel,
    MeshOptions,
    Sampling,
    check_search_settings,
    search_cone,
    with_fingers,
)
from grasp3d.settings.pose_error import PoseError
from grasp3d.settings.sampling import check_cost
from grasp3d.surface.antipodal import best_pairs
from grasp3d.surface.contacts import SAME_POINT, SurfaceContacts, critical_angles, grasps_at
from grasp3d.surface.grasp_numbers import BEFORE_ENUMERATION, check_combinations_of
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.load_case import DENSITY, LoadCase, input_warnings
from grasp3d.surface.multifinger import search
from grasp3d.surface.vertex_fields import Reason, SearchReport
from grasp3d.system.context import refuse_warnings, report_progress, within

BEFORE_ANGLES = 0.9
"""Fraction of the work that the search is expected to take if angles are computed after it."""


@dataclass(frozen=True, eq=False)
class Labelling:
    """An object to be labelled, with settings that are consistent with it and one another.

    Raises:
        SettingError: As in `label_surface`.
        MeshError: Labels for so many fingers would need too much memory.
    """

    mesh: ObjectMesh
    model: GraspModel
    sampling: Sampling
    scene: Scene | None
    """The gripper that must reach each grasp; None: ideal points."""
    load: Load | None
    """What each grasp must hold; None: nothing."""

    def __post_init__(self) -> None:
        mesh, model, scene = self.mesh, self.model, self.scene
        mesh.check_units(model, self.sampling)
        check_search_settings(model, self.sampling)
        if scene is not None:
            mesh.needs_metres(IN_METRES)
            scene.hand.check_fingers(model.fingers)
            if scene.jaws is not None and self.sampling.grip != "squeeze":
                raise SettingError(
                    f"gripper {scene.hand.name!r} grips from outside; leave out grip "
                    f"{self.sampling.grip} (--grip), or the gripper"
                )
        if self.load is not None:
            LoadCase.of(self.load, mesh, model, None if scene is None else scene.hand)
        if model.method == "extremes":
            check_combinations_of(model)
        most, count = mesh.options.max_memory, len(mesh.vertices)
        check_cost(count, most, mesh.report.source, "use a coarser mesh", model.fingers)
        refuse_warnings(input_warnings(mesh, scene, self.load, model, self.sampling))

    @classmethod
    def read(
        cls,
        source: MeshSource,
        model: GraspModel,
        sampling: Sampling,
        reach: ReachSettings,
        load: Load | None,
        options: MeshOptions,
        *,
        force: bool = False,
    ) -> "Labelling":
        """Read a mesh, and check the user's settings for it.

        Args:
            source: The mesh, as in `load_mesh`.
            model: As in `label_surface`.
            sampling: As in `label_surface`.
            reach: The gripper that must reach each grasp, and what the object stands on.
            load: As in `label_surface`.
            options: How the mesh is read and prepared.
            force: Accept lengths that are implausible for an object of this size.

        Raises:
            SettingError: As in `label_surface`, or a length is implausible.
            MeshError: The mesh cannot be read, or is too large.
        """
        hand = reach.hand is not None
        mesh = _mesh_of(source, options, model, sampling, load, hand=hand)
        if not force:
            refuse_lengths(mesh, model, sampling)
        return cls(mesh, model, sampling, Scene.of(reach, mesh), load)

    def labels(self) -> SurfaceLabels:
        """Search for the best grasp through every vertex, and label it; see `label_surface`."""
        enumerated = self.model.method == "extremes"
        with within(0.0, BEFORE_ENUMERATION if enumerated else 1.0):
            labels = self._searched()
        with within(BEFORE_ENUMERATION, 1.0):
            labels.compute_labels()
        return labels

    def _searched(self) -> SurfaceLabels:
        """Find the best grasps; labels are computed later."""
        mesh, model, sampling, scene = self.mesh, self.model, self.sampling, self.scene
        cone, error, pairs = search_cone(model, sampling), model.location_error, model.fingers == 2
        exact = pairs and error == 0.0  # else the search approximates angles
        with within(0.0, 1.0 if exact else BEFORE_ANGLES):
            if pairs:
                found = best_pairs(mesh, sampling, cone, scene=scene, location_error=error)
            else:
                found = search(mesh, model.fingers, sampling, cone, error)
        points, reason, reach = found.partner_points, found.reason.copy(), found.reach
        vertices = np.flatnonzero((reason == Reason.FOUND) & mesh.on_surface)
        if scene is not None and reach is None:
            contacts, grip = grasps_at(mesh, points, vertices), found.grip[vertices]
            signs = np.where(grip < 0, -1, 1)
            reached = scene.hand.reach(
                mesh, contacts.points, contacts.normals, grip=signs, table=scene.table,
                approach=scene.approach,
            )  # fmt: skip
            reason[vertices[~reached.reached]] = Reason.NOT_REACHED
            reach = reached.among(len(mesh.vertices), vertices)
            vertices = vertices[reached.reached]
        angles = np.stack([found.worst, found.best])
        if not exact:
            vertices = np.unique(mesh.canonical[vertices])
            contacts = grasps_at(mesh, points, vertices)
            with within(BEFORE_ANGLES, 1.0):
                angles[:, vertices] = critical_angles(contacts, location_error=error)
        report_progress(1.0)
        return SurfaceLabels.of_vertices(
            mesh,
            model,
            angles=(angles[0], angles[1]),
            partner_points=points,
            grip=found.grip,
            reason=reason,
            reach=reach,
            sampling=sampling,
            mode="label",
            search=SearchReport(cone, found.rays, found.evaluated),
            scene=scene,
            load=self.load,
        )


def label_surface(
    mesh: MeshSource,
    model: GivenModel = None,
    *,
    sampling: GivenSampling = None,
    hand: GivenHand = None,
    table: GivenTable = None,
    approach: Approach | None = None,
    pose_error: PoseError | str | None = None,
    scene: Scene | None = None,
    load: GivenLoad = None,
) -> SurfaceLabels:
    """Find the best grasp through every vertex and label how reliable it is.

    A grasp has `model.fingers` fingers, one at the vertex and the others at the best surface points
    that the search finds. With `model.method` 'extremes' the grasps are the same, but their labels
    come from the wrench hulls at extreme normals alone, as in Wan & Howe 2018.

    Args:
        mesh: The object: an `ObjectMesh`, or whatever `load_mesh` takes (a path, a mesh of trimesh,
            PyVista or Open3D, or a pair of arrays), which is then prepared with default options.
        model: Friction, sensor resolution [rad] and number of fingers, 2 to 5, or a dict of fields,
            {'friction': 0.4}; None: the defaults.
        sampling: How grasps are searched for, or a dict of fields; None: the defaults.
        hand: The gripper that must reach each grasp, or its name or file: the best grasp is then
            the best reachable one, and openings are limited to the stroke. None: ideal point
            contacts.
        table: What the object stands on, which the gripper must not enter: a table, 'as-is' (below
            the object as it is, z up) or 'stable' (below it in its most probable resting pose).
            None: nothing.
        approach: Approach directions of the gripper; None: any.
        pose_error: How wrong the gripper's poses may be, also as a text '5mm,3deg': `best_grasps`
            then tries wrong poses for the best grasps. None: poses are exact.
        scene: The gripper, table, approach and pose error together, in place of the four arguments.
        load: What each grasp must hold, and with which force; or just a mass, '0.5kg'.
            `labels.load_result` then has the grip force and payload of each grasp. A gripper brings
            its greatest force and the torsion radius of its pads. A load changes neither grasps nor
            labels. None: nothing.

    Returns:
        The labels. Their arrays have a row for each of the V vertices of `labels.mesh`, of which
        those of the file or of the given arrays come first, in their order: `label` (V,), 0 U, 1 M,
        2 S; `critical_angle` (V,) [rad]; `partners` (V, n - 1, 3), the opposing contacts in the
        mesh's frame; `partner_normals` (V, n - 1, 3), pointing into the object; and more.

    Raises:
        SettingError: The settings contradict each other, there are too many extreme normals, a
            length has a unit but the mesh has none, a gripper is given but the mesh has no unit, it
            has fewer vertices than fingers, or the load needs a mass or unit that is not known.
        MeshError: It is no mesh, or labels for so many fingers would need more memory than the
            mesh's options allow.

    Example:
        A box of 80 x 50 x 30 mm, most of which can be grasped reliably:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> labels = grasp3d.label_surface(mesh)
        >>> labels
        <SurfaceLabels of trimesh.Trimesh: 146 vertices, 2 fingers, μ 0.5, ...; S 67.4%, ...>
        >>> labels.label.shape, labels.partners.shape
        ((146,), (146, 1, 3))

        With openings of up to 35 mm, and a finer sensor:

        >>> import math
        >>> model = grasp3d.GraspModel(sensor_resolution=math.radians(10.0))
        >>> sampling = grasp3d.Sampling(max_opening=0.035)
        >>> labels = grasp3d.label_surface(mesh, model, sampling=sampling)
        >>> {name: round(fraction, 2) for name, fraction in labels.fractions().items()}
        {'S': 0.36, 'M': 0.16, 'U': 0.49}

        With a gripper, while the box stands on a table:

        >>> hand = grasp3d.ParallelGripper.preset("franka")
        >>> table = grasp3d.Table.below(mesh)
        >>> labels = grasp3d.label_surface(mesh, hand=hand, table=table)
        >>> labels.reach.poses.shape, bool(labels.reach.reached.any())
        ((146, 4, 4), True)

        With a load, here the box of 0.5 kg, turned in any direction:

        >>> labels = grasp3d.label_surface(mesh, hand=hand, load=grasp3d.Load(mass=0.5))
        >>> held = np.nanmax(labels.load_result.payload)  # nan: not reached
        >>> print(f"{labels.load_result.available:g} N hold {held:.1f} kg")
        70 N hold 3.6 kg
    """
    model = GraspModel.given("model", model) or GraspModel()
    sampling = Sampling.given("sampling", sampling)
    load, hand = Load.given("load", load), given_hand(hand)
    on_hand = hand is not None or scene is not None
    surface = _mesh_of(mesh, None, model, sampling, load, hand=on_hand)
    scene = scene or Scene.given(surface, hand, table, approach, pose_error)
    return Labelling(surface, model, sampling or Sampling(), scene, load).labels()


def _mesh_of(
    source: MeshSource, options: MeshOptions | None, *settings: object, hand: bool
) -> ObjectMesh:
    """Prepare a mesh; a missing unit that hand or settings need is an error before any work."""
    if isinstance(source, ObjectMesh):
        return load_mesh(source, options)
    has_density = any(isinstance(one, Load) and one.density is not None for one in settings)
    in_metres = IN_METRES if hand else DENSITY if has_density else ""
    return prepare(source, options or MeshOptions(), *settings, in_metres=in_metres)[0]


def scan_surface(mesh: MeshSource, model: GivenModel = None, *, fixed: ArrayLike) -> SurfaceLabels:
    """Fix all fingers but one and label every vertex as the contact point of the last finger.

    Wan & Howe 2018, Sec. III-B, fix one finger of two. Here the grasp is given, so a U is a proof
    as well, except at the position of a fixed finger (`Reason.SAME_POINT`). Grasps of two fingers
    may be external or internal.

    Args:
        mesh: The object: an `ObjectMesh`, or whatever `load_mesh` takes (a path, a mesh of trimesh,
            PyVista or Open3D, or a pair of arrays), which is then prepared with default options.
        model: Friction and sensor resolution [rad]; the number of fingers, unless it is the default
            2, must be one more than that of fixed fingers.
        fixed: Positions of the fixed fingers in the mesh's frame, shape (3,) or (k, 3),
            moved to the nearest surface points.

    Returns:
        Labels in mode 'scan', with arrays as in `label_surface`; `partners` are the fixed fingers.

    Raises:
        MeshError: It is no mesh.
        SettingError: `fixed` is not one or more finite points, or there are too many points or
            extreme normals.

    Example:
        One finger in the middle of a box's top; the vertices opposite to it are surely stable:

        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> scan = grasp3d.scan_surface(mesh, fixed=(0.0, 0.0, 0.015))
        >>> {name: round(fraction, 2) for name, fraction in scan.fractions().items()}
        {'S': 0.01, 'M': 0.08, 'U': 0.91}
        >>> mesh.vertices[scan.label == grasp3d.Label.S, 2].tolist()
        [-0.015]
    """
    mesh, points = load_mesh(mesh), _fixed_points(fixed)
    own_model = GraspModel.given("model", model) or GraspModel()
    own_model = with_fingers(own_model, len(points) + 1)
    mesh.check_units(own_model)
    if own_model.method == "extremes":
        check_combinations_of(own_model)
    count = len(mesh.vertices)
    nearest, on_surface, _ = nearest_surface_points(mesh, points)
    positions = (on_surface - mesh.center) / mesh.size  # normalised frame
    faces, weights = nearest.faces[None], nearest.weights[None]
    fixed_contacts = SurfaceContacts(mesh, SurfacePoints(faces, weights))  # one grasp
    searched = BEFORE_ENUMERATION if own_model.method == "extremes" and len(points) > 1 else 0.0
    if len(points) == 1:
        angles, grip = _scan_pairs(fixed_contacts, positions[0])
        if own_model.location_error > 0.0:
            angles = _scan_given(fixed_contacts, positions, own_model.location_error)
    else:
        with within(0.0, searched or 1.0):
            angles = _scan_given(fixed_contacts, positions, own_model.location_error)
        grip = np.zeros(count, dtype=np.int8)
    # No finger fits where another one is, whatever their normals.
    angles[1, np.isinf(angles[0])] = math.inf
    labels = SurfaceLabels.of_vertices(
        mesh,
        own_model,
        angles=(angles[0], angles[1]),
        partner_points=SurfacePoints(np.tile(faces, (count, 1)), np.tile(weights, (count, 1, 1))),
        grip=grip,
        reason=np.where(np.isinf(angles[0, mesh.canonical]), Reason.SAME_POINT, Reason.FOUND),
        sampling=None,
        mode="scan",
        search=SearchReport(cone=math.pi),
    )
    with within(searched, 1.0):
        labels.compute_labels()
    return labels


def _fixed_points(fixed: ArrayLike) -> Floats:
    """Check the positions of fixed fingers; shape (k, 3)."""
    try:
        points = np.atleast_2d(np.asarray(fixed, dtype=np.float64))
    except (TypeError, ValueError):
        points = np.zeros((0, 3))
    if points.ndim != 2 or points.shape[1] != 3 or not len(points):
        points = np.full((1, 3), math.nan)
    if not np.isfinite(points).all():
        raise SettingError(
            f"fixed must be one point or more, each of three finite numbers; got {fixed!r}"
        )
    return points


def _scan_pairs(fixed: SurfaceContacts, position: Floats) -> tuple[Floats, npt.NDArray[np.int8]]:
    """Angles (2, V) and grips (V,) of every vertex with one fixed finger."""
    mesh = fixed.mesh
    normals = fixed.sets.normals[:0] if (fixed.sets.counts == 0).any() else fixed.sets.normals
    angles = np.empty((2, len(mesh.vertices)))
    grip = np.empty(len(mesh.vertices), dtype=np.int8)
    scan(position, normals, mesh.normalized, mesh.contact_normals, angles[0], angles[1], grip)
    return angles, grip


def _scan_given(fixed: SurfaceContacts, positions: Floats, location_error: float) -> Floats:
    """Angles (2, V) of the grasps that every vertex makes with the fixed fingers."""
    mesh = fixed.mesh
    vertices = used_indices(mesh.faces)
    distances = np.linalg.norm(mesh.normalized[vertices, None] - positions, axis=2).min(axis=1)
    vertices = vertices[distances > SAME_POINT]
    others = np.broadcast_to(fixed.surface_points.faces, (len(mesh.vertices), len(positions)))
    weights = np.broadcast_to(fixed.surface_points.weights, (*others.shape, 3))
    grasps = grasps_at(mesh, SurfacePoints(others, weights), vertices)
    angles = np.full((2, len(mesh.vertices)), math.inf)
    angles[:, vertices] = critical_angles(grasps, location_error=location_error)
    return angles
