"""Tables with one grasp or none in each row: labels, epsilon and forces, computed when read.

Rows with the same grasp, such as vertices at one position, share its numbers: whatever takes long
is computed once for each distinct grasp.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import cached_property
from typing import Any, Self, TypeVar

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, computed, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.hand.frames import ObjectPose
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene, scene_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.critical_angle import force_closure
from grasp3d.quality.force_ranges import EpsilonRange
from grasp3d.quality.loads import Load, load_settings
from grasp3d.quality.measures import ALL
from grasp3d.settings import GraspModel
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import MEANING, Label, label_angles
from grasp3d.surface.contacts import SurfaceContacts, critical_angles
from grasp3d.surface.fields import CONTACTS, GRASPS, Field, columns_of, present
from grasp3d.surface.grasp_numbers import (
    EPSILON_RTOL,
    hull_labels,
    surface_epsilons,
    surface_load_result,
    surface_metrics,
)
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.surface.load_case import LoadCase, LoadResult, at_rows
from grasp3d.system.documents import package_version

NO_POSES = (
    "the grasps have no poses: give those that best_grasps names on a surface labelled with a "
    "gripper (--hand, in Python hand=...)"
)

Columns = dict[str, npt.NDArray[Any]]


@dataclass(frozen=True, eq=False, kw_only=True)
class GraspRows(LabelledGrasps):
    """One grasp on an object or none in each of b rows: contacts, label, epsilon, forces.

    Whatever takes long is computed when it is first read. The grasps are given, or were found by a
    search; S means surely stable, U surely unstable.
    """

    contacts: SurfaceContacts
    """Contacts, on the surface or where closed jaws touch, shape (b, n)."""
    model: GraspModel
    """Friction and sensor resolution; `fingers` is the number of contacts."""
    critical_angle: Floats
    """Critical friction angle over the worst normals and locations of the contacts [rad], (b,).

    inf where there is no grasp, or all contacts are at one point; nan at poses whose jaws do not
    close.
    """
    critical_angle_best: Floats
    """The same over the best normals and locations, shape (b,); different only for contacts on
    creases, and if locations are uncertain."""
    grip: npt.NDArray[np.int8] | None = None
    """Two fingers: +1 for an external grasp, -1 for an internal one, shape (b,); 0: no grasp, or
    three fingers and more; None: unknown."""
    scene: Scene | None = None
    """The gripper of the grasps, and what it must not touch; None: ideal points."""
    reach: Reach | None = None
    """How the gripper reaches each grasp, with its pose, rows (b,); None: no gripper."""
    load: Load | None = None
    """What each grasp must hold; None: `load_result` is not computed."""
    __repr__ = short_repr

    @property
    def size(self) -> int:
        """Number of rows."""
        return len(self.critical_angle)

    @property
    def mesh(self) -> ObjectMesh:
        """The object."""
        return self.contacts.mesh

    @property
    def first(self) -> Ints:
        """The first row that has the same grasp, shape (b,); -1: no grasp."""
        return np.arange(self.size)

    @cached_property
    def distinct(self) -> Ints:
        """The first row of each distinct grasp, shape (d,)."""
        return locked(np.flatnonzero(self.first == np.arange(self.size)))

    @cached_property
    def distinct_contacts(self) -> SurfaceContacts:
        """Contacts of the distinct grasps, shape (d, n)."""
        return self.contacts.take(self.distinct)

    def spread(self, values: npt.NDArray[Any]) -> npt.NDArray[Any]:
        """Copy values of the distinct grasps (d, ...) to all rows; nan, or 0, without a grasp."""
        return locked(at_rows(values, self.distinct, self.size + 1)[self.first])

    @cached_property
    def load_case(self) -> LoadCase | None:
        """The load on this object, with its mass, task and available force; None: no load."""
        if self.load is None:
            return None
        hand = None if self.scene is None else self.scene.hand
        return LoadCase.of(self.load, self.mesh, self.model, hand)

    @computed
    def label(self) -> Bytes:
        """`Label` codes by `model.method`: 0 U, 1 M, 2 S; shape (b,).

        With method exact it is S iff `critical_angle` is below `model.sure_angle`, and U iff
        `critical_angle_best` is at least `model.unstable_from`.
        """
        if self.model.method == "exact":
            worst, best = self.critical_angle, self.critical_angle_best
            return locked(label_angles(worst, best, self.model))
        codes = np.full(len(self.distinct), Label.U, dtype=np.uint8)
        finite = np.isfinite(self.critical_angle[self.distinct])
        codes[finite] = hull_labels(self.distinct_contacts.take(finite), self.model)
        return self.spread(codes)

    @computed
    def epsilon_range(self) -> EpsilonRange:
        """`epsilon`, `epsilon_min` and `epsilon_max`, rows (b,); nan: no grasp."""
        found = surface_epsilons(self.distinct_contacts, self.model)
        return EpsilonRange(*map(self.spread, (found.nominal, found.minimum, found.maximum)))

    @computed
    def load_result(self) -> LoadResult | None:
        """Grip force and payload under the load, rows (b,); None: there is no load."""
        if self.load_case is None:
            return None
        found = surface_load_result(self.distinct_contacts, self.model, self.load_case)
        outside = np.isinf(self.critical_angle_best[self.distinct])  # of the region
        return found.with_forces(outside, math.inf, math.inf, math.inf).each(self.spread)

    @cached_property
    def opening(self) -> Floats:
        """Largest distance between any two contacts, shape (b,); nan: no grasp."""
        return locked(_distances(self.contacts.points).max(axis=1, initial=0.0))

    def metrics(self, names: str | Sequence[str] = ALL) -> dict[str, Floats]:
        """Quality measures of each grasp, shape (b,) each; computed when called.

        Torques are divided by `mesh.torque_scale`, circular cones replaced by pyramids of 8 edges.
        nan where there is no grasp, and where a measure is undefined.

        Args:
            names: As in `quality.metrics`: 'all', or names in a list or separated by commas.

        Raises:
            SettingError: An unknown name.
        """
        values = surface_metrics(self.distinct_contacts, self.model, names)
        return {name: self.spread(column) for name, column in values.items()}

    def take(self, rows: Ints) -> Self:
        """The chosen grasps, in that order, with all that has been computed for them.

        Args:
            rows: Their rows, shape (c,).
        """
        return chosen(type(self), self, rows)

    def using(self, **changed: Any) -> Self:
        """The same grasps with another model or load, without checks or a new search.

        Args:
            changed: Fields by name; a new model must keep the location error, which is in the
                angles.

        Raises:
            SettingError: The scene changes, but the gripper's reach is known for this one only.
        """
        if self.reach is not None and changed.get("scene", self.scene) is not self.scene:
            raise SettingError(
                "how a gripper reaches grasps is known for its own scene only; label the surface "
                "with the other one (in Python label_surface(..., scene=...))"
            )
        return replace(self, **changed)

    def settings(self) -> dict[str, Any]:
        """Settings that the grasps were evaluated with, as files have them; angles in radians."""
        load: dict[str, Any] = {}
        if self.load_case is not None:
            load = {**load_settings(self.load), **self.load_case.settings()}
        if self.load_result is not None:
            load |= self.load_result.settings()
        return {
            **settings_of(self.mesh, self.model, self.scene),
            "epsilon_min": self.model.tilts,
            "epsilon_max": "sampled_tilts" if self.model.method == "extremes" else "upper_bound",
            **{name: value for name, value in load.items() if value is not None},
        }


@dataclass(frozen=True, eq=False, kw_only=True)
class GraspTable(GraspRows):
    """Grasps on an object, one in each of b rows.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> grasps = grasp3d.best_grasps(labels, 2)
        >>> grasps.to_dataframe()[["grasp", "label", "rank", "opening"]].round(3)
           grasp label  rank  opening
        0      1     S     5     0.08
        1      2     S     5     0.08
    """

    moved: Floats | None = None
    """Values of `distance`, shape (b, n); None: the contacts were found on the surface."""

    def __len__(self) -> int:
        return self.size

    @cached_property
    def rank(self) -> Ints:
        """Dimension of the span of the wrenches, in which epsilon is computed, shape (b,).

        It is 6, or 5 for hard fingers on one line, such as any two, or 0 where normals cancel out.
        Epsilons of different rank are not comparable.
        """
        ranks = np.zeros(self.size, dtype=np.int64)
        rows = self.contacts.with_normals
        if len(rows):
            contacts = self.contacts.take(rows).contacts(self.model)
            ranks[rows] = force_closure(contacts).rank
        return locked(ranks)

    @property
    def distance(self) -> Floats:
        """Distance of each contact from the surface before it was moved there, shape (b, n)."""
        return np.zeros((self.size, self.contacts.count)) if self.moved is None else self.moved

    @property
    def poses(self) -> Floats | None:
        """Poses of the gripper, from its frame to the mesh's, shape (b, 4, 4); None: no gripper.

        nan where the gripper does not reach the grasp.
        """
        return None if self.reach is None else self.reach.poses

    def poses_in(self, object_pose: ObjectPose | str | ArrayLike) -> Floats:
        """Poses of the gripper in the frame of a robot, shape (b, 4, 4), translations in metres.

        nan where the gripper does not reach the grasp.

        Args:
            object_pose: Pose of the object in that frame: a 4x4 matrix, translation in metres, or a
                text such as '0.4,0,0.1,90'; see `ObjectPose`.

        Raises:
            ContactError: It is no such pose.
            SettingError: The grasps have no poses.

        Example:
            >>> import trimesh
            >>> import grasp3d
            >>> box = trimesh.creation.box([80.0, 50.0, 30.0])
            >>> mesh = grasp3d.load_mesh(box, unit="mm", max_edge="20mm")
            >>> labels = grasp3d.label_surface(mesh, hand=grasp3d.read_hand("franka"))
            >>> labels.take(labels.distinct).poses_in("0.4,0,0.1,90").shape[1:]
            (4, 4)
        """
        if self.poses is None:
            raise SettingError(NO_POSES)
        return ObjectPose.of(object_pose).matrix @ self.poses

    @cached_property
    def separation(self) -> Floats:
        """Smallest distance between any two contacts, shape (b,)."""
        return locked(_distances(self.contacts.points).min(axis=1, initial=math.inf))

    def whole(self) -> "GraspTable":
        """The same grasps, with critical angles computed anew from their contacts."""
        error = self.model.location_error
        worst, best = critical_angles(self.contacts, location_error=error)
        return replace(self, critical_angle=worst, critical_angle_best=best)

    def columns(self, metrics: Mapping[str, Floats] | None = None) -> Columns:
        """Columns of files for each grasp as a whole, by name, shape (b,) each.

        Args:
            metrics: Quality measures of the grasps, which become columns too.
        """
        return {**columns_of(GRASPS, self), **(metrics or {})}

    def contact_values(self) -> list[tuple[Field, npt.NDArray[Any]]]:
        """Fields of files for each contact, with values (b, n, ...) without negative zeros."""
        return [
            (field, values + 0.0 if field.outward else values)
            for field, values in present(CONTACTS, self)
        ]

    def table_columns(self, metrics: Mapping[str, Floats] | None = None) -> Columns:
        """Columns of tables, in which contacts have numbers, shape (b,) each.

        Args:
            metrics: As in `columns`.

        Returns:
            The columns, and `unit`, that of the lengths: m, or empty where it is not known.
        """
        columns, contacts = self.columns(metrics), self.contact_values()
        for number in range(self.contacts.count):
            for field, values in contacts:
                names = [f"{name}{number + 1}" for name in field.columns or (field.name,)]
                flat = values[:, number].reshape(len(values), len(names))
                columns |= dict(zip(names, flat.T, strict=True))
        return columns | {"unit": np.full(self.size, self.mesh.unit or "")}

    def to_table(self) -> Any:
        """Return a `pyarrow.Table` with a row for each grasp: the columns of `write_grasps`."""
        from grasp3d.system.tables import table_of_columns

        return table_of_columns(self.table_columns(), settings=self.settings())


COMPUTED = frozenset({"label", "epsilon_range", "load_result", "robustness", "approach_margin"})
"""Attributes that take long to compute, and are kept when rows are taken."""

Rows = TypeVar("Rows", bound=GraspRows)


def chosen(kind: type[Rows], grasps: GraspRows, rows: Ints) -> Rows:
    """Make a table of another kind from chosen rows, with all that has been computed for them."""
    names = {field.name for field in fields(kind)}
    values = {name: rows_of(values, rows) for name, values in vars(grasps).copy().items()
              if name in names | COMPUTED}  # fmt: skip
    found = kind(**{name: values.pop(name) for name in names & values.keys()})
    vars(found).update(values)
    return found


def rows_of(values: Any, rows: Ints) -> Any:
    """Take the chosen rows of a value that has a row for each grasp; return others as they are."""
    if isinstance(values, np.ndarray):
        return locked(values[rows])
    return values.take(rows) if hasattr(values, "take") else values


def _distances(points: Floats) -> Floats:
    """Distances of all pairs of contacts of each grasp (b, n, 3), shape (b, n (n - 1) / 2)."""
    first, second = np.triu_indices(points.shape[1], 1)
    return np.asarray(np.linalg.norm(points[:, second] - points[:, first], axis=2))


def settings_of(mesh: ObjectMesh, model: GraspModel, scene: Scene | None) -> dict[str, Any]:
    """Settings that grasps on an object were evaluated with, as files have them.

    Args:
        mesh: The object.
        model: Friction and sensor resolution; angles in radians.
        scene: The hand, which is stated beside the poses, and the table; None: ideal points.
    """
    meaning = MEANING["scan"]
    surroundings = {} if scene is None else scene_settings(scene)
    surroundings.pop("gripper", None)
    return {
        "version": package_version(),
        "source": mesh.report.source,
        **plain_values(model),
        **plain_values(mesh.options),
        "unit": mesh.unit or "unknown",
        "size": mesh.size,
        "center_mass": mesh.center_mass.tolist(),
        "torque_scale": mesh.torque_scale,
        "epsilon_rtol": EPSILON_RTOL,
        "labels": {label.name: meaning[label] for label in sorted(Label)},
        **surroundings,
    }
