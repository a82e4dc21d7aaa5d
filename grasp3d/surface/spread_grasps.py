"""A table of grasps spread over vertices or poses: each has a row of the table, or none."""

import math
from collections.abc import Sequence
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.loads import Load
from grasp3d.quality.measures.measuring import MetricValues
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.holding import Holding
from grasp3d.surface.labelled_grasps import LabelledGrasps
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.rows import NO_ROW, spread


class SpreadGrasps(LabelledGrasps):
    """Places, such as vertices or poses, that have a grasp each, or none.

    The grasps are the rows of a table; arrays have a row for each of the k places.
    """

    grasps: GraspTable
    row: Ints
    no_angle: ClassVar[float] = math.inf
    """Critical angle of places without a grasp."""
    no_grasp: ClassVar[str] = "there is no grasp"
    """Why they have no quality measures."""

    @property
    def mesh(self) -> ObjectMesh:
        """The object."""
        return self.grasps.mesh

    @property
    def model(self) -> GraspModel:
        """Friction and sensor resolution, and the number of fingers."""
        return self.grasps.model

    @property
    def scene(self) -> Scene | None:
        """The gripper of the grasps, and what it must not touch; None: ideal points."""
        return self.grasps.scene

    @property
    def load(self) -> Load | None:
        """What each grasp must hold; None: `holding` is not computed."""
        return self.grasps.load

    @property
    def load_case(self) -> LoadCase | None:
        """The load on this object, with its mass, task and force at hand; None: no load."""
        return self.grasps.load_case

    @cached_property
    def critical_angle(self) -> Floats:
        """Critical friction angle over the worst normals of the contacts [rad], shape (k,).

        inf at vertices without a grasp, nan at poses whose jaws do not close.
        """
        return self._spread(self.grasps.critical_angle, self.no_angle)

    @cached_property
    def critical_angle_best(self) -> Floats:
        """The same over the best normals, shape (k,).

        Different at creases, and where locations are uncertain: there it is that of the best
        aligned grasp, which may have less margin than that of `critical_angle`.
        """
        return self._spread(self.grasps.critical_angle_best, self.no_angle)

    @cached_property
    def located_angles(self) -> WorstAndBest:
        """Critical angles (worst, best) with all that is not known about the contacts [rad].

        Shape (k,) each; see `GraspTable.located_angles`.
        """
        if self.model.is_uniform:
            return self.critical_angle, self.critical_angle_best
        worst, best = self.grasps.located_angles
        return self._spread(worst, self.no_angle), self._spread(best, self.no_angle)

    @cached_property
    def label(self) -> Bytes:
        """`Label` codes by `model.method`: 0 U, 1 M, 2 S; shape (k,)."""
        return self._spread(self.grasps.label, Label.U)

    @cached_property
    def epsilon_range(self) -> EpsilonRange:
        """`epsilon`, `epsilon_min` and `epsilon_max`, shape (k,); computed when first read."""
        epsilon = self.grasps.epsilon_range
        return EpsilonRange(
            self._spread(epsilon.nominal, math.nan),
            self._spread(epsilon.minimum, math.nan),
            self._spread(epsilon.maximum, math.nan),
        )

    @cached_property
    def holding(self) -> Holding | None:
        """Grip force and payload under the load, rows (k,); None: there is no load.

        Computed when first read; see `GraspTable.holding`.
        """
        holding = self.grasps.holding
        return None if holding is None else holding.spread(self.row)

    def metrics(self, names: str | Sequence[str] = "all") -> MetricValues:
        """Quality measures of each place's grasp, shape (k,) each; computed when called.

        nan where there is no grasp, and where a measure is undefined, with the reason; see
        `GraspTable.metrics`.

        Args:
            names: As in `quality.metrics`: 'all', or names in a list or separated by commas.

        Raises:
            SettingError: An unknown name.
        """
        rows = np.flatnonzero(self.row != NO_ROW)
        values = self.grasps.metrics(names).take(self.row[rows])
        return values.placed(rows, len(self.row), self.no_grasp)

    def computed(self, name: str) -> Any:
        """What has been computed already: `label`, `epsilon_range`, ...; None: it has not been.

        Args:
            name: An attribute that is computed when it is first read.
        """
        is_known = name in vars(self) or self.grasps.computed(name) is not None
        return getattr(self, name) if is_known else None

    def _spread(self, values: npt.NDArray[Any], missing: float) -> npt.NDArray[Any]:
        """Values of the table's rows at each place, shape (k, ...)."""
        return spread(values, self.row, missing)
