"""Labels on a surface: one value per vertex, and how reliable the grasp there is."""

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from grasp3d._kernels import candidates
from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked
from grasp3d.contacts import Contacts
from grasp3d.distributions import SampledAngles
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.places import SurfacePlaces
from grasp3d.progress import Progress
from grasp3d.quality import epsilon
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.stability import Label, Mode, label_angles, max_resolution
from grasp3d.surface_extremes import SurfaceGrasps, hull_epsilons, hull_labels
from grasp3d.tilting import EpsilonRange, epsilon_range

ROUNDING = 1e-9
"""Angle by which a question may exceed the search cone [rad]."""

EPSILON_RTOL = 1e-2
"""How much of epsilon's upper bound may lie between its bounds."""

BOUND_RTOL = 3e-2
"""The same for the largest epsilon, which is a bound in any case; symmetric grasps gain most."""


class Reason(IntEnum):
    """Why a vertex has no grasp at all."""

    FOUND = candidates.FOUND
    """It has one."""
    NO_PARTNER = candidates.NO_PARTNER
    """No ray within the search cone met a place for the second finger."""
    OPENING = candidates.OPENING
    """Every partner was outside the opening limits."""
    OFF_SURFACE = 3
    """The vertex belongs to no face."""
    SAME_PLACE = 4
    """The vertex is where the fixed finger stands."""


@dataclass(frozen=True)
class SearchReport:
    """How far the search for grasps went."""

    cone: float
    """Half-angle about the inward normals within which every direction counted [rad]."""
    rays: int
    """Rays traced."""
    rounds: int
    """Rounds of refinement about the best grasps."""
    still_falling: float
    """Share of the vertices that the last trial of their neighbours' partners still improved."""


@dataclass(frozen=True, eq=False)
class SurfaceLabels:
    """One value per vertex: the best grasp found there and how reliable it is.

    Arrays have one row per vertex of `mesh`, positions are in its unit and frame. An S is a proof:
    `partner` names the second contact and the critical angle of that grasp is exact. In mode
    'label' a U says that no grasp was found; in mode 'scan', where the grasp is given, that it is
    surely unstable.
    """

    mesh: ObjectMesh
    model: GraspModel
    sampling: Sampling | None
    """How grasps were searched; None in a scan, where they are given."""
    mode: Mode
    critical_angle: Floats
    """Critical friction angle over the worst normals of the contacts [rad]; inf: no grasp. (V,)"""
    critical_angle_best: Floats
    """The same over the best normals; differs at creases only. (V,)"""
    partner: Floats
    """Second contact of the vertex's best grasp; nan where there is none. (V, 3)"""
    partner_normal: Floats
    """Inward unit normal at the second contact. (V, 3)"""
    places: SurfacePlaces
    """Second contacts on the faces, shape (V, 2): of the best grasp over the worst normals, which
    is `partner`, and of the best one over the best normals."""
    opening: Floats
    """Distance between the two contacts. (V,)"""
    grip: npt.NDArray[np.int8]
    """+1: the fingers squeeze, -1: they push apart, 0: no grasp. (V,)"""
    reason: Bytes
    """`Reason` codes. (V,)"""
    search: SearchReport
    threads: int | None = None
    """Threads for epsilon, which is computed when it is first asked for; None: one per processor.
    The result does not depend on it."""

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes, shape (V,): 0 U, 1 M, 2 S; `model.method` says how they are made."""
        if self.model.method == "extremes":
            return _hull_labels(self, None)
        return locked(label_angles(self.critical_angle, self.critical_angle_best, self.model))

    @cached_property
    def max_resolution(self) -> Floats:
        """Coarsest sensor resolution below which the grasp is S [rad], shape (V,); 0: none."""
        return locked(max_resolution(self.critical_angle, self.model))

    @property
    def epsilon(self) -> Floats:
        """Epsilon (Ferrari & Canny 1992) of the vertex's best grasp, shape (V,).

        At the contacts' nominal normals: `mesh.normals`, the middle of the normals at a crease, and
        `partner_normal`; about the mesh's centre of mass, torques divided by `mesh.torque_scale`,
        in the span of the wrenches (`model.epsilon_rank`). Certified from below, within 1 %. 0
        where the grasp is not closed, nan where there is none.
        """
        return self.epsilon_range.nominal

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts within the sensor's resolution, shape (V,).

        Of the grasp with `partner`. `model.tilts` says how: 'exact', by the 'effective_friction' of
        polygonal cones, or over 'sampled_tilts' for soft fingers and with method extremes; see
        `tilting.epsilon_range`.
        """
        return self.epsilon_range.minimum

    @property
    def epsilon_max(self) -> Floats:
        """What epsilon reaches at most over all tilts, shape (V,): a bound.

        With method extremes it is the largest over the combinations of extreme normals, attained.
        It is 0 at a few creases labelled M, whose label comes from another grasp, better over the
        best normals.
        """
        return self.epsilon_range.maximum

    @cached_property
    def epsilon_range(self) -> EpsilonRange:
        """`epsilon`, `epsilon_min` and `epsilon_max`; computed when first asked for."""
        return _epsilon_range(self, None)

    def enumerate_extremes(self, progress: Progress) -> None:
        """Compute the labels of method extremes now; exact ones need no time.

        Args:
            progress: Called with the share of the work done, from 0 to 1.

        Raises:
            SettingError: A grasp has too many combinations of extreme normals.
        """
        if self.model.method == "extremes" and "label" not in vars(self):
            vars(self)["label"] = _hull_labels(self, progress)
            progress(1.0)

    def measure(self, progress: Progress) -> None:
        """Compute `epsilon_range` now.

        Args:
            progress: Called with the share of the work done, from 0 to 1.
        """
        if "epsilon_range" not in vars(self):
            vars(self)["epsilon_range"] = _epsilon_range(self, progress)

    def relabel(
        self, *, friction: float | None = None, sensor_resolution: float | None = None
    ) -> "SurfaceLabels":
        """Label the same grasps for another friction or resolution: a threshold, no new rays.

        Epsilon is that of the new model at the same grasps. With method extremes the hulls are
        enumerated anew.

        Args:
            friction: Coulomb coefficient; None: unchanged.
            sensor_resolution: Resolution alpha [rad]; None: unchanged.

        Raises:
            SearchCoverageError: Grasps that would now count were outside the search cone.
            SettingError: A value is outside its range.
        """
        model = replace(
            self.model,
            friction=self.model.friction if friction is None else friction,
            sensor_resolution=(
                self.model.sensor_resolution if sensor_resolution is None else sensor_resolution
            ),
        )
        needed = search_cone(model, Sampling())
        if needed > max(self.search.cone, search_cone(self.model, Sampling())) + ROUNDING:
            raise SearchCoverageError(
                f"atan(friction) + alpha/2 is {math.degrees(needed):.4g} degrees, but grasps were "
                f"searched only up to {math.degrees(self.search.cone):.4g}; label the surface "
                f"again with Sampling(search_angle={needed:.4g})"
            )
        return replace(self, model=model)

    def fractions(self, *, weights: Literal["area", "vertex"] = "area") -> dict[str, float]:
        """Shares of the surface that are S, M and U.

        Args:
            weights: 'area': each vertex counts with the area around it; 'vertex': all alike.
        """
        return {
            label.name: float(self._weights(weights)[self.label == label].sum())
            for label in sorted(Label, reverse=True)
        }

    def angle_distribution(self, *, weights: Literal["area", "vertex"] = "area") -> SampledAngles:
        """Shares of the surface by critical angle: S, M and U at any friction and resolution.

        They are exact shares, whatever `model.method` is. Questions beyond the cone that was
        searched raise SearchCoverageError.

        Args:
            weights: As in `fractions`.
        """
        shares = self._weights(weights)
        counts = shares > 0.0
        return SampledAngles(
            worst=locked(self.critical_angle[counts]),
            best=locked(self.critical_angle_best[counts]),
            weights=locked(shares[counts]),
            limit=self.search.cone,
        )

    def angle_quantiles(
        self, levels: npt.ArrayLike, *, weights: Literal["area", "vertex"] = "area"
    ) -> Floats:
        """Quantiles of the critical angle over the surface [rad]; inf where no grasp was found.

        Args:
            levels: From 0 to 1, shape (k,).
            weights: As in `fractions`.

        Raises:
            SettingError: A level is outside its range.
        """
        return self._quantiles(self.critical_angle, levels, weights)

    def epsilon_quantiles(
        self,
        levels: npt.ArrayLike,
        *,
        of: Literal["nominal", "minimum", "maximum"] = "nominal",
        weights: Literal["area", "vertex"] = "area",
    ) -> Floats:
        """Quantiles of epsilon over the surface; where no grasp was found it counts as 0.

        Args:
            levels: From 0 to 1, shape (k,).
            of: Which of `epsilon_range`.
            weights: As in `fractions`.

        Raises:
            SettingError: A level is outside its range, or no epsilon is called so.
        """
        if of not in {"nominal", "minimum", "maximum"}:
            raise SettingError(f"no epsilon is called {of!r}; known: nominal, minimum, maximum")
        return self._quantiles(np.nan_to_num(getattr(self.epsilon_range, of)), levels, weights)

    def _quantiles(
        self, values: Floats, levels: npt.ArrayLike, weights: Literal["area", "vertex"]
    ) -> Floats:
        shares = np.asarray(levels, dtype=np.float64)
        if not ((shares >= 0.0) & (shares <= 1.0)).all():
            raise SettingError(f"quantile levels must be from 0 to 1; got {levels!r}")
        order = np.argsort(values, kind="stable")
        reached = np.cumsum(self._weights(weights)[order])
        index = np.searchsorted(reached, shares * reached[-1])
        return np.asarray(values[order][np.minimum(index, len(order) - 1)])

    def _weights(self, weights: Literal["area", "vertex"]) -> Floats:
        if weights == "area":
            values = self.mesh.vertex_areas
        elif weights == "vertex":
            values = self.mesh.on_surface.astype(np.float64)
        else:
            raise SettingError(f"no weights are called {weights!r}; known: area, vertex")
        return np.asarray(values / values.sum())


def _hull_labels(labels: SurfaceLabels, progress: Progress | None) -> Bytes:
    """Labels of method extremes: the better of a vertex's two grasps, where they differ."""
    mesh = labels.mesh
    held = np.unique(mesh.canonical[labels.reason == Reason.FOUND])
    codes = np.full(len(mesh.vertices), Label.U, dtype=np.uint8)
    differ = held[_moved(labels, held)]  # a few, at creases
    for number, (vertices, told) in enumerate(((held, progress), (differ, None))):
        grasps = _grasps(labels, vertices, number)
        found = hull_labels(grasps, labels.model, threads=labels.threads, progress=told)
        codes[vertices] = np.maximum(codes[vertices], found)
    return locked(codes[mesh.canonical])


def _moved(labels: SurfaceLabels, vertices: Ints) -> Bools:
    """Where the grasp of the best normals is not that of the worst."""
    faces, weights = labels.places.faces[vertices], labels.places.weights[vertices]
    return np.asarray((faces[:, 0] != faces[:, 1]) | (weights[:, 0] != weights[:, 1]).any(axis=1))


def _grasps(labels: SurfaceLabels, vertices: Ints, number: int) -> SurfaceGrasps:
    places = SurfacePlaces(
        labels.places.faces[vertices, number], labels.places.weights[vertices, number]
    )
    return SurfaceGrasps(labels.mesh, vertices, places)


def _epsilon_range(labels: SurfaceLabels, progress: Progress | None) -> EpsilonRange:
    """Epsilons of every vertex's grasp, once for each place that has one."""
    mesh, model = labels.mesh, labels.model
    places = _held_places(labels)
    contacts = Contacts(
        np.stack([mesh.vertices[places], labels.partner[places]], axis=1) - mesh.center_mass,
        np.stack([mesh.normals[places], labels.partner_normal[places]], axis=1),
        model.friction,
        model.torsion_radius,
    )
    common: dict[str, Any] = {
        "edges": model.edges,
        "actuation": model.actuation,
        "torque_scale": mesh.torque_scale,
        "rtol": EPSILON_RTOL,
        "threads": labels.threads,
    }
    values = np.full((3, len(mesh.vertices)), math.nan)
    if model.method == "extremes":
        values[0, places] = epsilon(contacts, **common).lower
        values[1:, places] = hull_epsilons(
            _grasps(labels, places, 0),
            model,
            rtol=EPSILON_RTOL,
            threads=labels.threads,
            progress=progress,
        )
    else:
        found = epsilon_range(
            contacts, model.tilt, bound_rtol=BOUND_RTOL, progress=progress, **common
        )
        values[:, places] = found.nominal, found.minimum, found.maximum
    return EpsilonRange(*(locked(row[mesh.canonical]) for row in values))


def _held_places(labels: SurfaceLabels) -> Ints:
    """Vertices that stand for a place with a grasp; normals that cancel out are none to push on."""
    mesh = labels.mesh
    pushing = (mesh.normals != 0.0).any(axis=1) & (labels.partner_normal != 0.0).any(axis=1)
    held = (labels.reason == Reason.FOUND) & pushing
    return np.unique(mesh.canonical[held])
