"""Result of labelling a surface: the best grasp at every vertex, its label and epsilon.

It contains the settings with which the labels were computed, as labelled files do.
"""

import json
import math
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Any, Self

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.hand.scene import Scene, scene_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.loads import load_settings
from grasp3d.settings import ANGLE_ROUNDING, GraspModel, Sampling, search_cone
from grasp3d.settings.grasp_model import model_line
from grasp3d.settings.parsing import plain_values
from grasp3d.settings.sampling import not_covered
from grasp3d.stability.angle_distributions import SampledAngles
from grasp3d.stability.label import Label, Mode
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.surface.contacts import grasps_at
from grasp3d.surface.fields import XYZ, Arrays, present
from grasp3d.surface.grasp_numbers import EPSILON_RTOL
from grasp3d.surface.grasp_table import GraspRows, GraspTable, chosen
from grasp3d.surface.sweeps import Weights, label_fractions, quantiles, vertex_weights
from grasp3d.surface.vertex_fields import VERTICES, Reason, SearchReport
from grasp3d.system.documents import package_version
from grasp3d.system.names import unknown

if TYPE_CHECKING:
    import pyvista
    import trimesh


SETTING = "setting_"
"""Prefix of settings that are stored beside arrays, some of which have the name of a setting."""

GIVEN_ANGLE = "given_angle"
"""Key in the setting `search` of the given `search_angle`; its value is None for the model's."""

Values = dict[str, str | float | int | None]


def chosen_settings(
    mesh: ObjectMesh,
    model: GraspModel,
    sampling: Sampling | None,
    mode: Mode,
    scene: Scene | None = None,
) -> Values:
    """Settings that the user chooses, known before the mesh is labelled.

    Settings of a load are in `load_settings`.
    """
    return {
        "source": _ascii(mesh.report.source),
        "mode": mode,
        **plain_values(model),
        **({} if sampling is None else plain_values(sampling)),
        **plain_values(mesh.options),
        "region": _ascii(str(mesh.options.region)),
        "unit": mesh.file_unit or "unknown",
        "lengths": mesh.unit or "unknown",
        **scene_settings(scene),
    }


def _ascii(text: str) -> str:
    """A text as one line of ASCII characters, as headers need."""
    return text.encode("unicode_escape", "surrogateescape").decode("ascii")


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceLabels(GraspRows):
    """The best grasp found at every vertex of a surface, and its reliability.

    Arrays have one row per vertex of `mesh`; positions are in its unit and frame. An S is a proof:
    `partners` are the opposing contacts, and the critical angle of that grasp is exact (for three
    fingers and more on creases it is an upper bound). In mode 'label' a U means that no grasp was
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
        ((42, 29), <trimesh.Trimesh(vertices.shape=(42, 3), faces.shape=(80, 3))>, 42)
    """

    reason: Bytes
    """`Reason` codes, shape (V,)."""
    sampling: Sampling | None
    """How grasps were searched for; None in a scan, where they are given."""
    mode: Mode
    search: SearchReport

    @classmethod
    def of_vertices(
        cls,
        mesh: ObjectMesh,
        model: GraspModel,
        *,
        angles: WorstAndBest,
        partner_points: SurfacePoints,
        grip: ArrayLike,
        reason: ArrayLike,
        **others: Any,
    ) -> Self:
        """Make labels from the grasps of a surface's vertices; vertices at one position share one.

        Args:
            mesh: The surface.
            model: Friction and sensor resolution.
            angles: Critical angles (worst, best) [rad], shape (V,) each.
            partner_points: As the attribute.
            grip: As the field; one number for all vertices or shape (V,).
            reason: `Reason` codes of the vertices on the surface, shape (V,).
            **others: Other fields by name: sampling, mode, search, scene, reach, load.
        """
        outside = np.where(mesh.on_surface, Reason.EXCLUDED, Reason.OFF_SURFACE)
        reasons = locked(np.where(mesh.allowed, reason, outside), np.uint8)
        first, found = mesh.canonical, reasons == Reason.FOUND
        others_at = SurfacePoints(
            np.where(found[:, None], partner_points.faces, -1),
            np.where(found[:, None, None], partner_points.weights, 0.0),
        )
        worst, best = (locked(np.where(found, one[first], math.inf)) for one in angles)
        return cls(
            contacts=grasps_at(mesh, others_at, first),
            model=model,
            critical_angle=worst,
            critical_angle_best=best,
            grip=locked(np.where(found, np.broadcast_to(grip, len(first))[first], 0), np.int8),
            reason=reasons,
            **others,
        )

    def __repr__(self) -> str:
        model = self.model
        has_labels = model.method == "exact" or self.computed("label") is not None
        areas = self.fractions() if has_labels else {}
        fractions = (f"{name} {fraction:.1%}" for name, fraction in areas.items())
        return (
            f"<SurfaceLabels of {self.mesh.report.source}: {self.size:,} vertices, "
            f"{model.fingers} fingers, {model_line(model, metres=self.mesh.unit is not None)}; "
            f"{', '.join(fractions) or 'not labelled yet'}>"
        )

    @property
    def first(self) -> Ints:
        """The first vertex at the same position, shape (V,); -1: no grasp."""
        return np.where(self.reason == Reason.FOUND, self.mesh.canonical, -1)

    def take(self, rows: Ints) -> GraspTable:  # type: ignore[override]
        """The grasps of chosen vertices as a table, with all that has been computed for them.

        Args:
            rows: Vertices that have a grasp, shape (c,).
        """
        return chosen(GraspTable, self, rows)

    @property
    def partners(self) -> Floats:
        """Opposing contacts of the vertex's best grasp, shape (V, n - 1, 3); nan: no grasp."""
        return self.contacts.points[:, 1:]

    @cached_property
    def partner_normals(self) -> Floats:
        """Inward unit normals of `partners`, on creases the middle of the set, (V, n - 1, 3)."""
        return self.spread(self.distinct_contacts.normals[:, 1:])

    @cached_property
    def partner_points(self) -> SurfacePoints:
        """Opposing contacts as surface points, shape (V, n - 1); face -1: no grasp."""
        points = self.contacts.surface_points
        return SurfacePoints(locked(points.faces[:, 1:]), locked(points.weights[:, 1:]))

    @property
    def reachable(self) -> Bools | None:
        """Whether the gripper reaches the grasp of each vertex, shape (V,); None: no gripper."""
        return None if self.reach is None else locked(self.reach.reached)

    @property
    def approach(self) -> Floats | None:
        """Direction from which the gripper comes, the z axis of its pose, shape (V, 3).

        nan where it reaches no grasp; None: no gripper.
        """
        return None if self.reach is None else locked(self.reach.poses[:, :3, 2])

    @property
    def approach_margin(self) -> Floats | None:
        """Angle by which the approach may turn either way about the closing axis [rad], shape (V,).

        nan where the gripper reaches no grasp; None: no gripper.
        """
        return None if self.reach is None else self.reach.approach_margin

    def relabel(
        self,
        *,
        friction: float | tuple[float, float] | None = None,
        sensor_resolution: float | None = None,
    ) -> "SurfaceLabels":
        """Label the same grasps for another friction or resolution, without a new search.

        Epsilon and grip forces are those of the new model at the same grasps. With method extremes
        the hulls are enumerated again.

        Args:
            friction: Coulomb coefficient or interval; None: unchanged.
            sensor_resolution: Resolution alpha [rad]; None: unchanged.

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
            <SurfaceLabels of trimesh.Trimesh: 482 ...; S 68.0%, M 19.0%, U 13.0%>
        """
        fields = {"friction": friction, "sensor_resolution": sensor_resolution}
        changed: dict[str, Any] = {name: one for name, one in fields.items() if one is not None}
        model = replace(self.model, **changed)
        self.mesh.check_units(model)
        needed = search_cone(model)
        if needed > max(self.search.cone, search_cone(self.model)) + ANGLE_ROUNDING:
            raise not_covered("atan(friction) + alpha/2", needed, self.search.cone)
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
            {'S': 0.67, 'M': 0.0, 'U': 0.33}
        """
        return label_fractions(self.label, vertex_weights(self.mesh, weights))

    def angle_distribution(self, *, weights: Weights = "area") -> SampledAngles:
        """Distribution of critical angles: fractions S, M and U at any friction and resolution.

        They are those of method exact, whatever `model.method` is. Settings that need a wider cone
        than was searched raise SearchCoverageError.

        Args:
            weights: As in `fractions`.

        Example:
            >>> import trimesh
            >>> import grasp3d
            >>> cone = trimesh.creation.cone(radius=0.03, height=0.1, sections=32)
            >>> mesh = grasp3d.load_mesh(cone, unit="m", max_edge=0.02)
            >>> angles = grasp3d.label_surface(mesh).angle_distribution()
            >>> found = angles.fractions(friction=0.5, sensor_resolution=0.1)
            >>> {name: round(fraction, 2) for name, fraction in found.items()}
            {'S': 0.68, 'M': 0.19, 'U': 0.13}
        """
        values = vertex_weights(self.mesh, weights)
        weighted = values > 0.0
        worst, best = self.critical_angle, self.critical_angle_best
        return SampledAngles(
            worst=locked(worst[weighted]),
            best=locked(best[weighted]),
            weights=locked(values[weighted]),
            limit=self.search.cone,
            fingers=self.model.fingers,
        )

    def quantiles(
        self, name: str, levels: ArrayLike, *, weights: Weights = "area"
    ) -> Floats | None:
        """Quantiles of a column over the surface, shape (k,); None: the labels do not have it.

        Where no grasp was found, an angle or a force counts as inf, and any other value as 0.

        Args:
            name: `critical_angle`, `epsilon`, `payload` or another column of one number.
            levels: From 0 to 1, shape (k,).
            weights: As in `fractions`.

        Raises:
            SettingError: A level is outside its range, or there is no such column.
        """
        known = {field.name: field for field in VERTICES if not field.shape}
        if name not in known:
            raise SettingError(unknown("column", name, known))
        values = known[name].values_of(self)
        if values is None:
            return None
        filled = np.where(np.isnan(values), known[name].worst, values)
        return quantiles(filled, levels, vertex_weights(self.mesh, weights))

    def settings(self) -> Values:
        """Settings and versions that the labels were computed with; angles in radians."""
        model, search = self.model, self.search
        u_means = "no_grasp_found" if self.mode == "label" else "surely_unstable"
        return {
            "version": package_version(),
            **chosen_settings(self.mesh, model, self.sampling, self.mode, self.scene),
            **({} if self.load is None else load_settings(self.load)),
            "search_angle": search.cone,
            "rays_traced": search.rays,
            "candidates_evaluated": search.evaluated,
            "file_vertices": self.mesh.file_vertices,
            "epsilon_rank": model.epsilon_rank,
            "torque_scale": self.mesh.torque_scale,
            "epsilon_rtol": EPSILON_RTOL,
            "epsilon_min": model.tilts,
            "epsilon_max": "sampled_tilts" if model.method == "extremes" else "upper_bound",
            **({} if self.load_result is None else self.load_result.settings()),
            "label_codes": (
                f"{Label.U:d}=U({u_means}) {Label.M:d}=M(cannot_tell) {Label.S:d}=S(stable)"
            ),
        }

    def complete_settings(self) -> Values:
        """`settings`, with those that restore the mesh, and the extent of the search."""
        mesh, sampling = self.mesh, self.sampling
        surface: dict[str, Any] = {
            "center": mesh.center.tolist(),
            "size": mesh.size,
            "center_mass": mesh.center_mass.tolist(),
            "volume": mesh.volume,
            "report": asdict(mesh.report),
        }
        angle = None if sampling is None else sampling.search_angle
        return {
            **self.settings(),
            "surface": json.dumps(surface),
            "search": json.dumps({**asdict(self.search), GIVEN_ANGLE: angle}),
        }

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
        from grasp3d.system.tables import table_of_columns

        pairs = [(field, values) for field, values in present(VERTICES, self) if field.table]
        columns = {
            name: part for field, values in pairs for name, part in field.as_columns(values).items()
        }
        columns |= dict(zip(XYZ, self.mesh.vertices.T, strict=True))
        texts = {field.name: field.texts for field, _ in pairs if field.texts}
        return table_of_columns(columns, texts, settings=self.complete_settings())

    def to_trimesh(self) -> "trimesh.Trimesh":
        """Return a `trimesh.Trimesh` coloured by label.

        Every array is in its `vertex_attributes`: those of the file that `write_npz` writes, with
        `partner_2`, `partner_2_normal` and so on for the other fingers. Computes epsilon.
        """
        from trimesh.visual import ColorVisuals

        surface, arrays = self.mesh.to_trimesh(), self._point_arrays()
        surface.visual = ColorVisuals(surface, vertex_colors=arrays.pop("color"))
        surface.vertex_attributes.update(arrays)
        surface.metadata["grasp3d"] = self.settings()
        return surface

    def to_polydata(self) -> "pyvista.PolyData":
        """Return a `pyvista.PolyData` with the arrays of the file that `write_vtp` writes.

        nan where there is no grasp. Computes epsilon.
        """
        data = self.mesh.to_polydata()
        for name, values in self._point_arrays().items():
            # An infinite value would stretch the colour map; nan has a separate colour.
            shown = (
                np.where(np.isinf(values), math.nan, values) if np.isinf(values).any() else values
            )
            data.point_data[name] = shown
        for key, value in self.complete_settings().items():
            data.field_data[f"{SETTING}{key}"] = [str(value)]
        return data

    def _point_arrays(self) -> Arrays:
        """Arrays over the vertices except their positions, with one for each finger."""
        fields = (field for field in VERTICES[1:] if field.array)
        return {
            name: part
            for field, values in present(fields, self)
            for name, part in field.as_points(values).items()
        }
