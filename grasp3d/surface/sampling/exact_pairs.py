"""The opposing contact of each vertex with the smallest critical angle, without rays.

For two fingers that squeeze, whose contacts are known exactly.
"""

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property, partial

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import BestPairs, PairLimits
from grasp3d._kernels.search.crease_contacts import bound_creases, faces_of_corners
from grasp3d._kernels.search.descent import descend_exactly
from grasp3d._kernels.search.face_contacts import PairDomain
from grasp3d._kernels.surface.face_tree import FaceTree, face_tree
from grasp3d._kernels.surface.normal_sets import ContactNormals
from grasp3d._kernels.surface.surface_contacts import Surface
from grasp3d.arrays import Floats, Ints
from grasp3d.system.context import report_progress

IN_ORDER = 128
"""Vertices that branch and bound takes one after the other; the first one starts without a
neighbour's contact. Independent of the threads, as the results depend on it."""

INSIDE_FACES = np.empty(0, dtype=np.int64)
"""In place of the faces with which corners are searched: contacts are inside faces."""


@dataclass(eq=False)
class ExactSearch:
    """Branch and bound over the faces, creases and corners of a surface."""

    surface: Surface
    sets: ContactNormals
    centres: Floats
    """Centre of each vertex's set of normals (V, 3)."""
    limits: PairLimits
    """Of which the largest opening counts."""
    grasps: BestPairs
    """Written."""
    executor: ThreadPoolExecutor
    evaluated: int = field(default=0, init=False)
    """Number of faces on which a contact was computed."""

    @cached_property
    def tree(self) -> FaceTree:
        """Tree over the faces, in the end over their creases and corners."""
        tree: FaceTree = face_tree(self.surface)
        return tree

    def in_order(self, vertices: Ints) -> Ints:
        """Vertices (n,) in the order of the tree, so that neighbours follow one another."""
        _, first = np.unique(self.surface.faces[self.tree.order], return_index=True)
        return vertices[np.argsort(first)]

    def search(self, vertices: Ints, cone: float, progress: tuple[float, float]) -> None:
        """Minimise the critical angles over the vertices' worst normals.

        Args:
            vertices: Vertices (n,), see `in_order`.
            cone: Largest angle that is searched for [rad].
            progress: Fractions of the work done before and after.
        """
        self._descend(vertices, cone, progress)

    def search_best_normals(
        self, vertices: Ints, cone: float, progress: tuple[float, float]
    ) -> None:
        """Minimise the critical angles over the contacts' best normals; see `search`, comes last.

        They differ from the others at creases: at those of the vertices, with contacts inside
        faces, and at those of the surface, with all vertices.
        """
        several = vertices[self.sets.counts[vertices] != 1]
        if len(several) == 0:
            return
        first, last = progress
        middle = 0.5 * (first + last)
        self._descend(several, cone, (first, middle), worst=False)
        owners = faces_of_corners(self.surface, self.sets)
        bound_creases(self.tree, owners, self.surface, self.sets)
        self._descend(vertices, cone, (middle, last), worst=False, owners=owners)

    def _descend(
        self,
        vertices: Ints,
        cone: float,
        progress: tuple[float, float],
        *,
        worst: bool = True,
        owners: Ints = INSIDE_FACES,
    ) -> None:
        """Call `descend_exactly` for some vertices at once, so that a search can be cancelled."""
        first, last = progress
        chunks = [vertices[i : i + IN_ORDER] for i in range(0, len(vertices), IN_ORDER)]
        descend = partial(self._descend_from, cone, worst, owners)
        for count, tried in enumerate(self.executor.map(descend, chunks), start=1):
            self.evaluated += tried
            report_progress(first + (last - first) * count / len(chunks))

    def _descend_from(self, cone: float, worst: bool, owners: Ints, vertices: Ints) -> int:
        domain = PairDomain(self.surface, self.sets, self.centres, self.tree, self.limits)
        tried: int = descend_exactly(vertices, worst, owners, cone, domain, self.grasps)
        return tried
