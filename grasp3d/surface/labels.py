"""Labels on a surface: one value per vertex, and how reliable the grasp there is."""

import math
from dataclasses import dataclass, replace
from enum import IntEnum
from functools import cached_property
from importlib import import_module
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from grasp3d._kernels import antipodal_candidates
from grasp3d.arrays import Bytes, Floats, locked
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel, Sampling, search_cone
from grasp3d.stability.angle_distributions import SampledAngles
from grasp3d.stability.label import Label, Mode
from grasp3d.stability.thresholds import label_angles, max_resolution
from grasp3d.surface.area_statistics import Weights, quantiles, vertex_weights
from grasp3d.surface.label_table import LEVELS, label_table
from grasp3d.surface.vertex_grasps import VertexGrasps
from grasp3d.system.progress import Progress

ROUNDING = 1e-9
"""Angle by which a question may exceed the search cone [rad]."""


class Reason(IntEnum):
    """Why a vertex has no grasp at all."""

    FOUND = antipodal_candidates.FOUND
    """It has one."""
    NO_PARTNER = antipodal_candidates.NO_PARTNER
    """No place for the other fingers was found within the search cone."""
    OPENING = antipodal_candidates.OPENING
    """Every place for the other fingers was outside the limits of openings or distances."""
    OFF_SURFACE = 3
    """The vertex belongs to no face."""
    SAME_PLACE = 4
    """The vertex is where a fixed finger stands."""


@dataclass(frozen=True)
class SearchReport:
    """How far the search for grasps went."""

    cone: float
    """Largest critical friction angle that counted [rad]; for two fingers the half-angle about the
    inward normals within which every direction did."""
    rays: int = 0
    """Rays traced, for two fingers."""
    settled: int = 0
    """Candidate grasps settled, for three and more."""
    rounds: int = 0
    """Rounds of refinement about the best grasps; of three fingers and more, how often the
    neighbours' grasps were tried."""
    still_falling: float = 0.0
    """Share of the vertices that the last trial of their neighbours' partners still improved."""


@dataclass(frozen=True, eq=False)
class SurfaceLabels:
    """One value per vertex: the best grasp found there and how reliable it is.

    Arrays have one row per vertex of `mesh`, positions are in its unit and frame. An S is a proof:
    `partners` names the other contacts, and the critical angle of that grasp is exact (on creases,
    of three fingers and more, at least it is not too small). In mode 'label' a U says that no grasp
    was found; in mode 'scan', where the grasp is given, that it is surely unstable.
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
    partners: Floats
    """The other contacts of the vertex's best grasp; nan where there is none. (V, n - 1, 3)"""
    partner_normals: Floats
    """Inward unit normals there, the middle of the normals on creases. (V, n - 1, 3)"""
    partner_points: SurfacePoints
    """The other contacts on the faces, shape (V, 2, n - 1): of the best grasp over the worst
    normals, which are `partners`, and of the best one over the best normals."""
    opening: Floats
    """Largest distance between any two contacts. (V,)"""
    grip: npt.NDArray[np.int8]
    """Two fingers: +1 where they squeeze, -1 where they push apart. 0: no grasp, and three fingers
    and more, which do neither. (V,)"""
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
            return self._grasps.hull_labels(self.model, None)
        return locked(label_angles(self.critical_angle, self.critical_angle_best, self.model))

    @cached_property
    def max_resolution(self) -> Floats:
        """Coarsest sensor resolution below which the grasp is S [rad], shape (V,); 0: none."""
        return locked(max_resolution(self.critical_angle, self.model))

    @property
    def epsilon(self) -> Floats:
        """Epsilon (Ferrari & Canny 1992) of the vertex's best grasp, shape (V,).

        At the contacts' nominal normals, the middle of the normals at a crease: `mesh.normals` and
        `partner_normals`; about the mesh's centre of mass, torques divided by `mesh.torque_scale`,
        in the span of the wrenches (`model.epsilon_rank`). Certified from below, within 1 %. 0
        where the grasp is not closed, nan where there is none.
        """
        return self.epsilon_range.nominal

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts within the sensor's resolution, shape (V,).

        Of the grasp with `partners`. `model.tilts` says how: 'exact', by the 'effective_friction'
        of polygonal cones, or over 'sampled_tilts' for soft fingers and with method extremes; see
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
        return self._grasps.epsilon_range(self.model, None)

    @property
    def _grasps(self) -> VertexGrasps:
        return VertexGrasps(
            mesh=self.mesh,
            partner_points=self.partner_points,
            found=self.reason == Reason.FOUND,
            threads=self.threads,
        )

    def enumerate_extremes(self, progress: Progress) -> None:
        """Compute the labels of method extremes now; exact ones need no time.

        Args:
            progress: Called with the share of the work done, from 0 to 1.

        Raises:
            SettingError: A grasp has too many combinations of extreme normals.
        """
        if self.model.method == "extremes" and "label" not in vars(self):
            vars(self)["label"] = self._grasps.hull_labels(self.model, progress)
            progress(1.0)

    def measure(self, progress: Progress) -> None:
        """Compute `epsilon_range` now.

        Args:
            progress: Called with the share of the work done, from 0 to 1.
        """
        if "epsilon_range" not in vars(self):
            vars(self)["epsilon_range"] = self._grasps.epsilon_range(self.model, progress)

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

    def fractions(self, *, weights: Weights = "area") -> dict[str, float]:
        """Shares of the surface that are S, M and U.

        Args:
            weights: 'area': each vertex counts with the area around it; 'vertex': all alike.
        """
        return {
            label.name: float(self._weights(weights)[self.label == label].sum())
            for label in sorted(Label, reverse=True)
        }

    def angle_distribution(self, *, weights: Weights = "area") -> SampledAngles:
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
            fingers=self.model.fingers,
        )

    def angle_quantiles(self, levels: npt.ArrayLike, *, weights: Weights = "area") -> Floats:
        """Quantiles of the critical angle over the surface [rad]; inf where no grasp was found.

        Args:
            levels: From 0 to 1, shape (k,).
            weights: As in `fractions`.

        Raises:
            SettingError: A level is outside its range.
        """
        return quantiles(self.critical_angle, levels, self._weights(weights))

    def epsilon_quantiles(
        self,
        levels: npt.ArrayLike,
        *,
        of: Literal["nominal", "minimum", "maximum"] = "nominal",
        weights: Weights = "area",
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
        values = np.nan_to_num(getattr(self.epsilon_range, of))
        return quantiles(values, levels, self._weights(weights))

    def show(self, **options: Any) -> Any:  # noqa: ANN401
        """Look at the surface: in a notebook as a page below the cell, elsewhere in a window.

        The page needs the extra `grasp3d[web]`; without it a notebook shows a picture.

        Args:
            options: As in `grasp3d.viewer.show.show`: settings, height, proxy.

        Raises:
            OutputError: Nothing can be drawn here.
        """
        # The viewer is a floor above, and heavy: found by its name when it is asked for, as pandas
        # does with what plots its tables.
        return import_module("grasp3d.viewer.show").show(self, **options)

    def _repr_html_(self) -> str:
        """A table of the shares and angles, as notebooks show it; epsilon only where measured."""
        known = self.model.method == "exact" or "label" in vars(self)
        values = self.epsilon_quantiles(LEVELS) if "epsilon_range" in vars(self) else None
        return label_table(
            source=self.mesh.report.source,
            model=self.model,
            mode=self.mode,
            count=len(self.reason),
            shares=self.fractions() if known else {},
            angles=self.angle_quantiles(LEVELS),
            epsilons=values,
            warnings=self.mesh.report.warnings,
        )

    def _weights(self, weights: Weights) -> Floats:
        return vertex_weights(self.mesh, weights)
