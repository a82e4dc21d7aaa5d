"""Result of labelling a surface: the best grasp at every vertex, its label and epsilon."""

from dataclasses import dataclass, replace
from importlib import import_module
from typing import TYPE_CHECKING, Any, Literal

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, locked
from grasp3d.settings import ANGLE_ROUNDING, check_choice, search_cone
from grasp3d.settings.model_text import model_line
from grasp3d.settings.sampling import not_covered
from grasp3d.stability.angle_distributions import SampledAngles
from grasp3d.surface.area_statistics import Weights, label_fractions, quantiles, vertex_weights
from grasp3d.surface.conversions import labels_to_polydata, labels_to_table, labels_to_trimesh
from grasp3d.surface.vertex_grasps import VertexGrasps

if TYPE_CHECKING:
    import pyvista
    import trimesh

Quantity = Literal["nominal", "minimum", "maximum"]


@dataclass(frozen=True, eq=False, kw_only=True)
class SurfaceLabels(VertexGrasps):
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
        ((42, 29), <trimesh.Trimesh(vertices.shape=(42, 3), faces.shape=(80, 3))>, 42)
    """

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
        return label_fractions(self.label, self._weights(weights))

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
        values = self._weights(weights)
        weighted = values > 0.0
        worst, best = self.critical_angle, self.critical_angle_best
        return SampledAngles(
            worst=locked(worst[weighted]),
            best=locked(best[weighted]),
            weights=locked(values[weighted]),
            limit=self.search.cone,
            fingers=self.model.fingers,
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
        self, levels: ArrayLike, *, of: Quantity = "nominal", weights: Weights = "area"
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
        return labels_to_table(self)

    def to_trimesh(self) -> "trimesh.Trimesh":
        """Return a `trimesh.Trimesh` coloured by label.

        Every array is in its `vertex_attributes`: those of the file that `write_npz` writes, with
        `partner_2`, `partner_2_normal` and so on for the other fingers. Computes epsilon.
        """
        return labels_to_trimesh(self)

    def to_polydata(self) -> "pyvista.PolyData":
        """Return a `pyvista.PolyData` with the arrays of the file that `write_vtp` writes.

        nan where there is no grasp. Computes epsilon.
        """
        return labels_to_polydata(self)

    def show(self, **options: Any) -> Any:
        """Show the surface: in a notebook as a page below the cell, elsewhere in a window.

        Args:
            options: As in `grasp3d.viewer.show.show`: settings, height, proxy.

        Raises:
            OutputError: Nothing can be shown in this environment.
        """
        # The viewer belongs to a higher layer and is slow to import, so it is imported by name when
        # it is needed, as pandas does with its plotting backends.
        return import_module("grasp3d.viewer.show").show(self, **options)

    def _weights(self, weights: Weights) -> Floats:
        return vertex_weights(self.mesh, weights)
