"""Search for the best grasp of three fingers and more through every vertex.

Contact 1 is the vertex. The others are placed at pairs of points of a blue-noise sample, and at the
vertex's best opposing contact of two fingers. The best candidates are refined: with three fingers
by steps toward a balance without friction, then by random steps. They are tried at neighbouring
vertices until none improves. Each further finger is added to the best grasp of one finger less.
Every candidate is evaluated by a closure test at the best critical angle so far, so the search may
miss a grasp, but every grasp that it returns is real.

At a crease the search uses all normals of a cap that contains the true ones. Grasps that it returns
hold for all of them, but a grasp that it passes over may be as good.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import FOUND, NO_PARTNER
from grasp3d._kernels.search.coplanar_contacts import make_plane
from grasp3d._kernels.search.multifinger import search_fingers
from grasp3d._kernels.search.multifinger_grasps import (
    BestGrasps,
    CandidatePoints,
    SearchLimits,
    make_best_grasps,
    make_hull_scratch,
    make_search_workspace,
)
from grasp3d.arrays import ArrayLike, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.mesh.turns import located_surface
from grasp3d.settings import Sampling
from grasp3d.surface.antipodal import FoundGrasps, best_pairs
from grasp3d.surface.candidate_points import candidate_points, contact_domain
from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
from grasp3d.system.context import report_progress, thread_count, unreported, within

CHUNK = 256
"""Vertices that a thread processes in one call."""

SEPARATION = 0.01
"""Default smallest distance between contacts, in object sizes."""

MAX_SEPARATION = 0.1
"""Largest default of `SEPARATION`, relative to the largest distance between contacts."""

MIN_SEPARATION = 1e-3
"""Distance between contacts below which they always count as coincident, relative to the object's
size, or to the largest distance between contacts if that is smaller."""

ALL_VERTICES_FACTOR = 4
"""Number of vertices per candidate point up to which all are used, if contacts are vertices."""

SURPLUS, MAX_SURPLUS = 16, 4096
"""Points sampled per candidate point, and their largest number; single fingers move to them."""

MAX_POINTS = 32_768
"""Largest number of points sampled, if contacts must be close, so that each vertex reaches some."""

STEPS = 80
"""Steps of the refinement from each start."""

NEIGHBOUR_STEPS = 40
"""Steps of the refinement of a neighbour's grasp."""

SWEEPS = 8
"""Largest number of rounds that try grasps, improved in the last one, at neighbouring vertices."""

GRID = 2.0**28
"""During the search, positions (in object sizes) and normals are whole multiples of 1 / GRID; the
grasps found are evaluated at their exact positions."""

MIN_GAIN = 0.1
"""Smallest decrease of a critical angle that counts, relative to the tolerance."""

SHORTEST_STEP = 0.05
"""Step length at which a refinement ends, relative to the tolerance: on a ball of the object's size
such a step turns the normal by this fraction of the tolerance."""


def search(
    mesh: ObjectMesh, fingers: int, sampling: Sampling, cone: float, location_error: float = 0.0
) -> FoundGrasps:
    """Search for the best grasp of three fingers and more through every vertex.

    The result does not depend on the number of threads.

    Args:
        mesh: The surface.
        fingers: Fingers of a grasp, 3 or more.
        sampling: Candidate points, limits of distances, seed and tolerance.
        cone: Largest critical friction angle that counts, at most 90 degrees [rad].
        location_error: Largest distance between true and perceived contacts [m]: the search takes
            into account how far normals turn, but not how far lines turn.

    Raises:
        SettingError: The mesh has fewer vertices than fingers, or is smaller than the separation.
    """
    if sampling.min_opening > mesh.size:
        raise SettingError(
            f"min_opening is {sampling.min_opening:g}, but no two points of the object, of "
            f"size {mesh.size:.4g}, are that far apart"
        )
    if location_error > 0.0:  # a grasp with a large angle need not be surely unstable
        cone = math.pi / 2.0
    smaller, limits = _without_unit(mesh, sampling)
    error = location_error / mesh.size
    with ThreadPoolExecutor(thread_count()) as executor:
        return _Search(smaller, limits, fingers, cone, error, executor).run()


def _without_unit(mesh: ObjectMesh, sampling: Sampling) -> tuple[ObjectMesh, Sampling]:
    """Convert an object and its limits of distances to the normalised frame, without last digits.

    Rounding errors in the last digits depend on the unit of lengths. On a regular object, where
    many grasps are equally good, they would choose among these. Mass and volume, which no search
    needs, stay as they are.
    """
    corners = mesh.corner_normals
    smaller = replace(
        mesh,
        vertices=locked(_on_grid(mesh.normalized)),
        corner_normals=replace(corners, normals=locked(_on_grid(corners.normals))),
        center=np.zeros(3),
        size=1.0,
    )
    most = max(float(_on_grid(sampling.max_opening / mesh.size)), 1.0 / GRID)
    least = float(_on_grid(sampling.min_opening / mesh.size))
    return smaller, replace(sampling, max_opening=most, min_opening=min(least, most))


def _on_grid(values: ArrayLike) -> Floats:
    return np.asarray(np.rint(GRID * np.asarray(values, np.float64)) / GRID + 0.0)  # no -0.0


@dataclass(eq=False)
class _Search:
    """State of one search, in the normalised frame, scaled to a largest distance of about 1."""

    mesh: ObjectMesh
    """The surface, in the normalised frame like the limits of distances in `sampling`."""
    sampling: Sampling
    fingers: int
    cone: float
    location_error: float
    executor: ThreadPoolExecutor
    evaluated: int = field(default=0, init=False)

    def __post_init__(self) -> None:
        mesh, sampling = self.mesh, self.sampling
        separation = min(SEPARATION, MAX_SEPARATION * sampling.max_opening)
        self.min_separation = max(separation, sampling.min_opening)
        self.on_vertices = sampling.candidate_points == "vertices"
        self.vertices = mesh.contact_vertices.copy()  # kernels take writable arrays
        if self.on_vertices and len(self.vertices) < self.fingers:
            raise SettingError(
                f"{self.fingers} fingers need as many vertices; there are {len(self.vertices)}"
            )
        all_vertices = (
            self.on_vertices and len(self.vertices) <= ALL_VERTICES_FACTOR * sampling.candidates
        )
        self.points_per_vertex = len(self.vertices) if all_vertices else sampling.candidates
        self.scale = 1.0 / min(1.0, sampling.max_opening)
        self.domain = contact_domain(
            mesh,
            located_surface(mesh, self.location_error, self.cone),
            self.scale,
            self._candidate_points(),
            on_vertices=self.on_vertices,
        )
        edges = self.domain.surface.points[mesh.faces]
        self.edge_length = float(np.linalg.norm(edges - np.roll(edges, 1, axis=1), axis=2).mean())
        self.step_length = math.sqrt(float(self.mesh.vertex_areas.sum()) / self.sampling.candidates)
        self.step_length *= 0.5 * self.scale

    def run(self) -> FoundGrasps:
        """Search for the best grasp of every vertex."""
        limits, done, stages = self._limits(), 0, 1 + SWEEPS
        total, grasps = (self.fingers - 2) * stages, make_best_grasps(len(self.mesh.vertices), 1)
        for n in range(3, self.fingers + 1):
            previous, grasps = grasps, make_best_grasps(len(self.mesh.vertices), n - 1)
            for stage in range(stages):
                if stage:
                    if not (grasps.stages == stage - 1).any():
                        break
                    previous = BestGrasps._make(one.copy() for one in grasps)
                with within(done / total, (done + 1) / total):
                    self._run(stage, n, limits, previous, grasps)
                done += 1
        return self._result(grasps)

    def _run(
        self, stage: int, n: int, limits: SearchLimits, previous: BestGrasps, grasps: BestGrasps
    ) -> None:
        """Run one stage of the search, in chunks distributed over the threads."""
        vertices, domain = self.vertices, self.domain
        size = max(1, min(CHUNK, -(-len(vertices) // (4 * thread_count()))))
        chunks = [vertices[i : i + size] for i in range(0, len(vertices), size)]
        step_length, rounds = self.step_length / 2.0**stage, NEIGHBOUR_STEPS if stage else STEPS

        def search_chunk(chunk: Ints) -> int:
            workspace = make_search_workspace(self.fingers, domain.candidates.common_count)
            search_fingers(
                stage, chunk, n, domain, limits, int(self.sampling.seed), step_length, rounds,
                previous, grasps, workspace, make_plane(),
                None if n == 3 else make_hull_scratch(n),
            )  # fmt: skip
            return int(workspace.evaluated[0])

        for count, evaluated in enumerate(self.executor.map(search_chunk, chunks), start=1):
            self.evaluated += evaluated
            report_progress(count / len(chunks))

    def _limits(self) -> SearchLimits:
        sampling = self.sampling
        return SearchLimits(
            min_distance=max(self.min_separation * self.scale, MIN_SEPARATION),
            max_distance=sampling.max_opening * self.scale,
            max_angle=self.cone,
            tolerance=MIN_GAIN * sampling.tolerance,
            margin=MIN_GAIN * sampling.tolerance,
            target=sampling.tolerance,
            points_per_vertex=self.points_per_vertex,
            edge_length=self.edge_length,
            shortest_step=SHORTEST_STEP * sampling.tolerance * self.scale,
        )

    def _candidate_points(self) -> CandidatePoints:
        count = max(self.points_per_vertex, min(SURPLUS * self.points_per_vertex, MAX_SURPLUS))
        count = max(count, min(math.ceil(self.points_per_vertex * self.scale**2), MAX_POINTS))
        opposing = None if self.on_vertices else self._opposing_contacts()
        return candidate_points(self.mesh, count, self.sampling.seed, self.scale, opposing)

    def _opposing_contacts(self) -> tuple[SurfacePoints, Ints]:
        """(points, vertices): smooth second contacts of the best antipodal grasps."""
        mesh = self.mesh
        sampling = Sampling(
            grip="both",
            min_opening=self.min_separation,
            max_opening=self.sampling.max_opening,
            tolerance=self.sampling.tolerance,
        )
        with unreported():
            pairs = best_pairs(mesh, sampling, self.cone, location_error=self.location_error)
        owners = self.vertices[pairs.partner_points.faces[self.vertices, 0] >= 0]
        points = SurfacePoints(
            pairs.partner_points.faces[owners], pairs.partner_points.weights[owners]
        )
        smooth = ~SurfaceContacts(mesh, points).on_crease[:, 0]
        return SurfacePoints(points.faces[smooth, 0], points.weights[smooth, 0]), owners[smooth]

    def _result(self, grasps: BestGrasps) -> FoundGrasps:
        faces, weights = grasps.elements, grasps.weights
        if self.on_vertices:
            has_contact = faces >= 0
            points = vertex_surface_points(self.mesh, np.maximum(faces, 0))
            faces = np.where(has_contact, points.faces, -1)
            weights = np.where(has_contact[..., None], points.weights, 0.0)
        canonical = self.mesh.canonical
        angles = grasps.angles[canonical]
        return FoundGrasps(
            worst=angles,
            best=angles,
            grip=np.zeros(len(angles), dtype=np.int8),
            partner_points=SurfacePoints(faces[canonical], weights[canonical]),
            reason=np.where(np.isinf(angles), NO_PARTNER, FOUND).astype(np.uint8),
            evaluated=self.evaluated,
        )
