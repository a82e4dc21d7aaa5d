"""Result of labelling a surface: the best grasp at every vertex, its label and epsilon."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from importlib import import_module
from typing import Any, Literal

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked
from grasp3d.errors import SearchCoverageError, SettingError
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import length_warnings
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.loads import Load
from grasp3d.settings import (
    ANGLE_ROUNDING,
    AnySampling,
    GraspModel,
    check_choice,
    sampling_kind,
    search_cone,
)
from grasp3d.settings.lengths import GivenLength
from grasp3d.settings.model_text import model_line
from grasp3d.settings.uncertainty import Uncertainty, friction_interval
from grasp3d.stability.angle_distributions import SampledAngles
from grasp3d.stability.label import Label, Mode
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.surface.area_statistics import Weights, quantiles, vertex_weights
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.grasp_table import COMPUTED, BestNormalGrasps, GraspTable, if_known, rows_of
from grasp3d.surface.label_table import LEVELS, label_table
from grasp3d.surface.read_contacts import ReadContacts
from grasp3d.surface.spread_grasps import NO_ROW, SpreadGrasps
from grasp3d.surface.vertex_grasps import Reason, grasps_at, grasps_differ

Quantity = Literal["nominal", "minimum", "maximum"]


@dataclass(frozen=True)
class SearchReport:
    """Extent of the search for grasps."""

    cone: float
    """Largest critical friction angle that was searched for [rad]; for two fingers the half-angle
    of the cones about the inward normals that were searched."""
    rays: int = 0
    """Number of rays traced, for two fingers."""
    evaluated: int = 0
    """Number of candidate grasps evaluated, for three fingers and more; for two fingers that
    squeeze, faces on which the best contact was computed, 0 where the search is by rays."""
    rounds: int = 0
    """Rounds of refinement about the best grasps; for three fingers and more, rounds in which the
    neighbours' grasps were evaluated."""
    still_falling: float = 0.0
    """Fraction of the vertices that the last evaluation of neighbours' contacts still improved."""


@dataclass(frozen=True, eq=False)
class SurfaceLabels(SpreadGrasps):
    """The best grasp found at every vertex of a surface, and its reliability.

    Arrays have one row per vertex of `mesh`; positions are in its unit and frame. An S is a proof:
    `partners` are the opposing contacts, and the critical angle of that grasp is exact (on creases,
    for three fingers and more, it is not too small). In mode 'label' a U means that no grasp was
    found; in mode 'scan', where the grasp is given, that it is surely unstable.

    Example:
        Export of the labels of a coarse ball to other libraries:

        >>> import trimesh
        >>> import grasp3d
        >>> ball = trimesh.creation.icosphere(1)
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(ball, max_edge=9.0))
        >>> [grasp3d.Label(code).name for code in labels.label[:3]]
        ['S', 'S', 'S']
        >>> labels.to_dataframe().shape, labels.to_trimesh(), labels.to_polydata().n_points
        ((42, 33), <trimesh.Trimesh(vertices.shape=(42, 3), faces.shape=(80, 3))>, 42)
    """

    grasps: GraspTable
    """The best grasps over the worst normals, a row for each position that has one; with those that
    are better over the best normals."""
    row: Ints
    """Row of each vertex's grasp in that table, -1: none, shape (V,)."""
    reason: Bytes
    """`Reason` codes, shape (V,); None: a file does not contain them."""
    sampling: AnySampling | None
    """How grasps were searched for; None in a scan, where they are given."""
    mode: Mode
    search: SearchReport
    reach: Reach | None = None
    """How the gripper reaches the grasp of each vertex, a row for each; None: no gripper.

    `reach.poses` (V, 4, 4) in the mesh's frame and unit, nan where there is no grasp;
    `reach.approach_margin` (V,) [rad]; and more.
    """

    @classmethod
    def of_vertices(
        cls,
        mesh: ObjectMesh,
        model: GraspModel,
        *,
        angles: WorstAndBest,
        partners: Floats | None,
        partner_points: SurfacePoints | None,
        grip: ArrayLike | None,
        reason: ArrayLike | None,
        reach: Reach | None = None,
        sampling: AnySampling | None,
        mode: Mode,
        search: SearchReport,
        scene: Scene | None = None,
        load: Load | None = None,
        threads: int | None = None,
        file: str | None = None,
    ) -> "SurfaceLabels":
        """Labels of the grasps of a surface's vertices, those of one position being the same.

        Args:
            mesh: The surface.
            model: Friction and sensor resolution.
            angles: Critical angles (worst, best) [rad], shape (V,) each.
            partners: As the attribute; None: unknown, in a file.
            partner_points: As the attribute; None: those nearest to the partners.
            grip: As the attribute; one number for all vertices or shape (V,); None: unknown.
            reason: `Reason` codes of the vertices on the surface, shape (V,); None: unknown, in a
                file; vertices with finite angles have a grasp.
            reach: As the field.
            sampling: As the field.
            mode: As the field.
            search: As the field.
            scene: The gripper that must reach each grasp, and the table; None: ideal points.
            load: What each grasp must hold; None: nothing.
            threads: As in `GraspTable`.
            file: Name of the file that the grasps were read from; None: that of the mesh.
        """
        count = len(mesh.vertices)
        reasons: Any = reason
        found = np.isfinite(angles[1]) & mesh.on_surface
        if reason is not None:
            reasons = locked(np.where(mesh.on_surface, reason, Reason.OFF_SURFACE), np.uint8)
            found = reasons == Reason.FOUND
        vertices = np.unique(mesh.canonical[found])
        row = np.full(count, NO_ROW, dtype=np.int64)
        row[vertices] = np.arange(len(vertices))
        own = None if partners is None else locked(partners[vertices])
        contacts: SurfaceContacts = ReadContacts(
            mesh, vertices, own, model.fingers, file or mesh.report.source
        )
        best_normals = None
        if partner_points is not None:
            contacts = grasps_at(mesh, partner_points, vertices, 0)
            best_normals = _best_normals(mesh, partner_points, vertices)
        table = GraspTable(
            contacts=contacts,
            model=model,
            critical_angle=locked(angles[0][vertices]),
            critical_angle_best=locked(angles[1][vertices]),
            best_normals=best_normals,
            points=None
            if own is None
            else locked(np.concatenate([mesh.vertices[vertices, None], own], axis=1)),
            grip=None if grip is None else locked(np.broadcast_to(grip, count)[vertices], np.int8),
            scene=scene,
            reach=None if reach is None else reach.take(vertices),
            load=load,
            threads=threads,
        )
        return cls(
            table, locked(row[mesh.canonical]), reasons, sampling=sampling, mode=mode,
            search=search, reach=reach,
        )  # fmt: skip

    def __repr__(self) -> str:
        model = self.model
        known = model.method == "exact" or self.computed("label") is not None
        found = self.fractions() if known else {}
        fractions = (f"{name} {fraction:.1%}" for name, fraction in found.items())
        return (
            f"<SurfaceLabels of {self.mesh.report.source}: {len(self.row):,} vertices, "
            f"{model.fingers} fingers, {model_line(model, self.mesh.unit)}; "
            f"{', '.join(fractions) or 'not labelled yet'}>"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """What may make the labels wrong, one sentence each.

        Warnings of the mesh, and lengths that are probably in another unit than the mesh. The
        command line refuses those that cannot be meant, unless it is given `--force`.
        """
        lengths = self.model.lengths() | self.mesh.options.lengths()
        if self.sampling is not None:
            lengths |= self.sampling.lengths()
        if self.load is not None:
            lengths |= self.load.lengths()
        return (
            *self.mesh.report.warnings,
            *length_warnings(lengths, self.mesh.size, self.mesh.unit),
        )

    @classmethod
    def of_values(
        cls,
        mesh: ObjectMesh,
        model: GraspModel,
        *,
        sampling: AnySampling | None,
        mode: Mode,
        search: SearchReport,
        scene: Scene | None = None,
        load: Load | None = None,
        values: Mapping[str, Any],
        file: str | None = None,
    ) -> "SurfaceLabels":
        """Labels whose values are known, from a file, instead of computed.

        What the file does not contain is None where it needs the opposing contacts and these are
        not known; else it is computed when it is read. Surface points that are not given are found
        when they are needed.

        Args:
            mesh: The surface.
            model: As in `of_vertices`, as what follows but `values`.
            sampling: How grasps were searched for.
            mode: Labels or a scan.
            search: Extent of the search.
            scene: The gripper and the table.
            load: What each grasp must hold.
            values: Attributes by name, with a row for each vertex: `critical_angle` and
                `critical_angle_best` [rad] at least, and others such as `label`, `located_angles`,
                `epsilon_range`, `holding`, `partners`, `partner_points`, `reason` or `reach`.
            file: Name of the file, for errors; None: that of the mesh.
        """
        worst, best = values["critical_angle"], values["critical_angle_best"]
        labels = cls.of_vertices(
            mesh, model, angles=(worst, best), partners=values.get("partners"),
            partner_points=values.get("partner_points"), grip=values.get("grip"),
            reason=values.get("reason"), reach=values.get("reach"), sampling=sampling, mode=mode,
            search=search, scene=scene, load=load, file=file,
        )  # fmt: skip
        known = {name: one for name, one in values.items() if one is not None}
        vars(labels).update(known)
        vars(labels.grasps).update(
            {name: rows_of(known[name], labels.vertices) for name in COMPUTED.intersection(known)}
        )
        return labels

    @cached_property
    def vertices(self) -> Ints:
        """The first vertex of each position that has a grasp: those of the table's rows."""
        own = self.mesh.canonical == np.arange(len(self.row))
        return locked(np.flatnonzero(own & (self.row != NO_ROW)))

    @cached_property
    def likely_reason(self) -> Bytes:
        """`reason`, or the likely one where a file does not contain it, shape (V,)."""
        if self.reason is not None:
            return self.reason
        none = Reason.SAME_POINT if self.mode == "scan" else Reason.NO_PARTNER
        reasons = np.where(self.row != NO_ROW, Reason.FOUND, none)
        return locked(np.where(self.mesh.on_surface, reasons, Reason.OFF_SURFACE), np.uint8)

    @cached_property
    def partners(self) -> Floats:
        """Opposing contacts of the vertex's best grasp, shape (V, n - 1, 3); nan: no grasp.

        None: read from a PLY, which does not have them.
        """
        own = self.grasps
        return if_known(own.known_contacts, lambda _: self._spread(own.positions[:, 1:], math.nan))

    @cached_property
    def partner_normals(self) -> Floats:
        """Inward unit normals there, the middle of the set on creases, shape (V, n - 1, 3).

        None: read from a PLY, which does not have them.
        """
        return if_known(
            self.grasps.known_contacts, lambda one: self._spread(one.normals[:, 1:], math.nan)
        )

    @cached_property
    def partner_points(self) -> SurfacePoints:
        """Opposing contacts as surface points, shape (V, 2, n - 1); face -1: no grasp.

        Of the best grasp over the worst normals, which are `partners`, and of the best grasp over
        the best normals. None: read from a PLY, which does not have them.
        """
        return if_known(self.grasps.known_contacts, self._spread_points)

    def _spread_points(self, contacts: SurfaceContacts) -> SurfacePoints:
        points, other = contacts.surface_points, self.grasps.best_normals
        faces = np.repeat(points.faces[:, None, 1:], 2, axis=1)
        weights = np.repeat(points.weights[:, None, 1:], 2, axis=1)
        if other is not None:
            faces[other.rows, 1] = other.contacts.surface_points.faces[:, 1:]
            weights[other.rows, 1] = other.contacts.surface_points.weights[:, 1:]
        return SurfacePoints(self._spread(faces, -1), self._spread(weights, 0.0))

    @cached_property
    def opening(self) -> Floats:
        """Largest distance between any two contacts, shape (V,); nan: no grasp.

        None: read from a PLY, which does not have it.
        """
        own = self.grasps
        return if_known(own.known_contacts, lambda _: self._spread(own.opening, math.nan))

    @cached_property
    def grip(self) -> npt.NDArray[np.int8]:
        """Two fingers: +1 for an external grasp, -1 for an internal one, shape (V,).

        0 where there is no grasp, and for three fingers and more. None: read from a PLY, which does
        not have it.
        """
        return if_known(self.grasps.grip, lambda grip: self._spread(grip, 0))

    @cached_property
    def reachable(self) -> Bools | None:
        """Whether the gripper reaches the grasp of each vertex, shape (V,); None: no gripper."""
        return None if self.reach is None else locked(self.reach.reached)

    @cached_property
    def approach(self) -> Floats | None:
        """Direction from which the gripper comes, the z axis of its pose, shape (V, 3).

        nan where it reaches no grasp; None: no gripper.
        """
        return None if self.reach is None else locked(self.reach.poses[:, :3, 2])

    @cached_property
    def approach_margin(self) -> Floats | None:
        """Angle by which the approach may turn either way about the closing axis [rad], shape (V,).

        nan where the gripper reaches no grasp; None: no gripper.
        """
        return None if self.reach is None else self.reach.approach_margin

    def using(self, **changed: Any) -> "SurfaceLabels":
        """The same grasps with another model or load, without checks or a new search.

        Args:
            changed: Fields of `GraspTable` by name; see `GraspTable.using`.
        """
        found = replace(self, grasps=self.grasps.using(**changed))
        vars(found).update({name: vars(self)[name] for name in _OF_SEARCH.intersection(vars(self))})
        return found

    def relabel(
        self,
        *,
        friction: float | tuple[float, float] | None = None,
        sensor_resolution: float | None = None,
        friction_error: float | None = None,
        normal_error: float | None = None,
        location_error: GivenLength | None = None,
        per_finger: str | Sequence[Uncertainty] | None = None,
    ) -> "SurfaceLabels":
        """Label the same grasps for another friction, resolution or error, without a new search.

        Epsilon and grip forces are those of the new model at the same grasps. With method extremes
        the hulls are enumerated again. The grasps are those that were best for the model of the
        search: with a larger location error others, with a larger opening, may have more margin.

        Args:
            friction: Coulomb coefficient or interval; None: unchanged.
            sensor_resolution: Resolution alpha [rad]; None: unchanged.
            friction_error: As in `GraspModel`; None: unchanged.
            normal_error: As in `GraspModel` [rad]; None: unchanged.
            location_error: As in `GraspModel`, in the mesh's unit or with a unit; None: unchanged.
            per_finger: As in `GraspModel`; None: unchanged.

        Raises:
            SearchCoverageError: The search cone was too narrow for the new values.
            SettingError: A value is outside its range.

        Example:
            >>> import trimesh
            >>> import grasp3d
            >>> cone = trimesh.creation.cone(radius=0.03, height=0.1, sections=32)
            >>> labels = grasp3d.label_surface(grasp3d.load_mesh(cone, unit="m", max_edge=0.02))
            >>> labels
            <SurfaceLabels of trimesh.Trimesh: 482 ...; S 0.0%, M 100.0%, U 0.0%>
            >>> labels.relabel(sensor_resolution=0.1)
            <SurfaceLabels of trimesh.Trimesh: 482 ...; S 68.0%, M 32.0%, U 0.0%>
        """
        given = {
            "friction": friction,
            "sensor_resolution": sensor_resolution,
            "friction_error": friction_error,
            "normal_error": normal_error,
            "location_error": location_error,
            "per_finger": per_finger,
        }
        changed: dict[str, Any] = {name: one for name, one in given.items() if one is not None}
        if friction is not None and len(set(friction_interval(friction))) > 1:
            changed.setdefault("friction_error", 0.0)  # the interval states it
        (model,) = self.mesh.in_own_unit(replace(self.model, **changed))
        needed = search_cone(model)
        if needed > max(self.search.cone, search_cone(self.model)) + ANGLE_ROUNDING:
            raise SearchCoverageError(
                f"atan(friction) + alpha/2 is {math.degrees(needed):.4g} degrees, but grasps were "
                f"searched only up to {math.degrees(self.search.cone):.4g}; label the surface "
                f"again with {sampling_kind(model.fingers).__name__}(search_angle={needed:.4g})"
            )
        return self.using(model=model)

    def fractions(self, *, weights: Weights = "area") -> dict[str, float]:
        """Fractions S, M and U of the surface.

        Args:
            weights: 'area': each vertex is weighted by the area around it; 'vertex': all equally.

        Example:
            >>> import trimesh
            >>> import grasp3d
            >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
            >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
            >>> {name: round(fraction, 2) for name, fraction in labels.fractions().items()}
            {'S': 0.67, 'M': 0.33, 'U': 0.0}
        """
        return {
            label.name: float(self._weights(weights)[self.label == label].sum())
            for label in sorted(Label, reverse=True)
        }

    def angle_distribution(
        self, *, weights: Weights = "area", location_error: GivenLength | None = None
    ) -> SampledAngles:
        """Distribution of critical angles: fractions S, M and U at any friction and resolution.

        They are those of method exact, whatever `model.method` is. Settings that need a wider cone
        than was searched raise SearchCoverageError. The angles are the located ones, with the
        largest tilt that any finger has beyond those of all: so a vertex is S where the worst is
        below atan(friction) minus the tilt of all fingers, and U where the best is at least
        atan(friction) plus it.

        Args:
            weights: As in `fractions`.
            location_error: As in `GraspModel`, instead of the model's own; None: that.

        Raises:
            SettingError: Fingers have a friction of their own.

        Example:
            >>> import trimesh
            >>> import grasp3d
            >>> cone = trimesh.creation.cone(radius=0.03, height=0.1, sections=32)
            >>> mesh = grasp3d.load_mesh(cone, unit="m", max_edge=0.02)
            >>> model = grasp3d.GraspModel(sensor_resolution=0.1, per_finger="; normal_error=2")
            >>> angles = grasp3d.label_surface(mesh, model).angle_distribution()
            >>> found = angles.fractions(friction=0.5, sensor_resolution=0.1)
            >>> {name: round(fraction, 2) for name, fraction in found.items()}
            {'S': 0.68, 'M': 0.32, 'U': 0.0}
        """
        if any(own.friction is not None for own in self.model.per_finger):
            raise SettingError(
                "fingers with a friction of their own have no distribution over friction: state "
                "the friction of all fingers (--friction) instead of that in per_finger"
            )
        values = self._weights(weights)
        weighted = values > 0.0
        labels = self if location_error is None else self.relabel(location_error=location_error)
        worst, best = labels.located_angles
        further = max(np.ravel(self.model.tilt_of_fingers)) - self.model.tilt
        return SampledAngles(
            worst=locked(worst[weighted] + further),
            best=locked(best[weighted] - further),
            weights=locked(values[weighted]),
            limit=self.search.cone,
            fingers=self.model.fingers,
            further_tilt=further,
        )

    def angle_quantiles(self, levels: ArrayLike, *, weights: Weights = "area") -> Floats:
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
        levels: ArrayLike,
        *,
        of: Quantity = "nominal",
        weights: Weights = "area",
    ) -> Floats:
        """Quantiles of epsilon over the surface; it is 0 where no grasp was found.

        Args:
            levels: From 0 to 1, shape (k,).
            of: Field of `epsilon_range`.
            weights: As in `fractions`.

        Raises:
            SettingError: A level is outside its range, or `of` is unknown.
        """
        check_choice("epsilon", of, Quantity)
        values = np.nan_to_num(getattr(self.epsilon_range, of))
        return quantiles(values, levels, self._weights(weights))

    def to_table(self) -> Any:
        """Return a `pyarrow.Table` with a row for each vertex: the columns of `write_fields`.

        Computes epsilon, which takes a wrench hull and more for each vertex.

        Example:
            >>> import trimesh
            >>> import grasp3d
            >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(1), max_edge=9.0)
            >>> table = grasp3d.label_surface(ball).to_table()
            >>> table.num_rows, table.column_names[:7]
            (42, ['x', 'y', 'z', 'nx', 'ny', 'nz', 'area'])
            >>> table["label"].unique().to_pylist()
            ['S']
        """
        return import_module("grasp3d.export.parquet").labels_to_table(self)

    def to_dataframe(self) -> Any:
        """Return `to_table` as a `pandas.DataFrame`; labels and reasons are categories.

        Raises:
            OutputError: pandas is not installed; the extra `grasp3d[pandas]` installs it.

        Example:
            >>> import trimesh
            >>> import grasp3d
            >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(1), max_edge=9.0)
            >>> frame = grasp3d.label_surface(ball).to_dataframe()
            >>> frame["label"].value_counts().to_dict()
            {'S': 42, 'U': 0, 'M': 0}
        """
        from grasp3d.system.tables import data_frame

        return data_frame(self.to_table())

    def to_trimesh(self) -> Any:
        """Return a `trimesh.Trimesh` coloured by label.

        Every array is in its `vertex_attributes`: those of the file that `write_npz` writes, with
        `partner_2`, `partner_2_normal` and so on for the other fingers. Computes epsilon.
        """
        return import_module("grasp3d.export.trimeshes").labels_to_trimesh(self)

    def to_polydata(self) -> Any:
        """Return a `pyvista.PolyData` with the arrays of the file that `write_vtp` writes.

        nan where there is no grasp. Computes epsilon.
        """
        return import_module("grasp3d.export.vtp").labels_to_polydata(self)

    def show(self, **options: Any) -> Any:
        """Show the surface: in a notebook as a page below the cell, elsewhere in a window.

        Args:
            options: As in `grasp3d.viewer.show.show`: settings, height, proxy.

        Raises:
            OutputError: Nothing can be shown in this environment.
        """
        # The viewer belongs to a higher layer and is slow to import, so it is imported by name when
        # it is needed, as pandas does with its plotting backends; so are the conversions above.
        return import_module("grasp3d.viewer.show").show(self, **options)

    def _repr_html_(self) -> str:
        """Table of fractions and angles for notebooks; epsilon only if it has been computed."""
        labelled = self.model.method == "exact" or self.computed("label") is not None
        has_epsilon = self.computed("epsilon_range") is not None
        return label_table(
            source=self.mesh.report.source,
            model=self.model,
            mode=self.mode,
            count=len(self.row),
            fractions=self.fractions() if labelled else {},
            angles=self.angle_quantiles(LEVELS),
            epsilons=self.epsilon_quantiles(LEVELS) if has_epsilon else None,
            warnings=self.warnings,
        )

    def _weights(self, weights: Weights) -> Floats:
        return vertex_weights(self.mesh, weights)


_OF_SEARCH = frozenset({
    "critical_angle", "critical_angle_best", "vertices", "partners", "partner_normals",
    "partner_points", "opening", "grip", "reachable", "approach", "approach_margin",
})  # fmt: skip
"""Attributes that depend on the grasps alone."""


def _best_normals(
    mesh: ObjectMesh, partner_points: SurfacePoints, vertices: Ints
) -> BestNormalGrasps | None:
    """The grasps of vertices over the best normals, where they differ; None: nowhere."""
    rows = np.flatnonzero(grasps_differ(partner_points, vertices))
    if not len(rows):
        return None
    return BestNormalGrasps(locked(rows), grasps_at(mesh, partner_points, vertices[rows], 1))
