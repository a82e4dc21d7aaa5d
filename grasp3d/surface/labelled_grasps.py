"""Base class of labelled vertices and given grasps: labels and epsilon."""

from collections.abc import Callable

from grasp3d.arrays import Bytes, Floats, locked
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings import GraspModel
from grasp3d.stability.sampled_normals import WorstAndBest
from grasp3d.stability.thresholds import margins, max_resolution
from grasp3d.surface.deferred import Deferred
from grasp3d.surface.holding import Holding
from grasp3d.system.progress import Progress


class LabelledGrasps:
    """Grasps on a surface, one for each row of the arrays, with labels and epsilon."""

    model: GraspModel
    deferred_located: Deferred[WorstAndBest]
    deferred_label: Deferred[Bytes]
    deferred_epsilon: Deferred[EpsilonRange]
    deferred_holding: Deferred[Holding] | None

    def _defer(
        self,
        located: Deferred[WorstAndBest],
        label: Callable[[Progress], Bytes],
        epsilon: Callable[[Progress], EpsilonRange],
        holding: Callable[[Progress], Holding] | None = None,
    ) -> None:
        """Set what is computed later, for the `__post_init__` of frozen dataclasses.

        Functions that refer to the dataclass itself would keep it alive with its copies.
        """
        object.__setattr__(self, "deferred_located", located)
        object.__setattr__(self, "deferred_label", Deferred(label))
        object.__setattr__(self, "deferred_epsilon", Deferred(epsilon))
        later = None if holding is None else Deferred(holding)
        object.__setattr__(self, "deferred_holding", later)

    @property
    def label(self) -> Bytes:
        """`Label` codes by `model.method`: 0 U, 1 M, 2 S."""
        return self.deferred_label.value

    @property
    def located_angles(self) -> WorstAndBest:
        """Critical angles (worst, best) with all that is not known about the contacts [rad].

        Uncertain contact locations turn the line between two contacts, and fingers of `per_finger`
        differ; see `stability.located_angles`. Without both they are `critical_angle` and
        `critical_angle_best`. The label is S iff the worst is below
        `model.effective_friction_angle`, U iff the best is at least `model.unstable_from`. Two
        contacts: exact, at creases safe; more: safe.
        """
        return self.deferred_located.value

    @property
    def margin(self) -> Floats:
        """Margin of the grasps [rad]: beta - alpha/2 - beta*, less all other uncertainties.

        S iff above 0 (with method exact); the angle by which friction may be smaller, or normals
        less certain, and the grasp is still surely stable. -inf where there is no grasp.
        """
        return locked(margins(self.located_angles[0], self.model))

    @property
    def max_resolution(self) -> Floats:
        """Coarsest sensor resolution below which the grasp is S [rad]; 0: none is fine enough.

        With the other uncertainties of the model as they are.
        """
        return locked(max_resolution(self.located_angles[0], self.model))

    @property
    def epsilon_range(self) -> EpsilonRange:
        """`epsilon`, `epsilon_min` and `epsilon_max`; computed when first read."""
        return self.deferred_epsilon.value

    @property
    def epsilon(self) -> Floats:
        """Epsilon of the grasps (Ferrari & Canny 1992).

        At the contacts' nominal normals, the middle of the set on creases; about the mesh's centre
        of mass, torques divided by `mesh.torque_scale`, in the span of the wrenches. Certified from
        below, within 1 %. 0 where the grasp is not force-closed, nan where there is no grasp or the
        normals at a contact cancel out.
        """
        return self.epsilon_range.nominal

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts within the sensor's resolution.

        `model.tilts` says how it is computed: 'exact', by the 'effective_friction' of polygonal
        cones, over 'sampled_tilts' for soft fingers and with method extremes, or as a 'bound' where
        contact locations are uncertain; see
        `quality.epsilon_range`.
        """
        return self.epsilon_range.minimum

    @property
    def epsilon_max(self) -> Floats:
        """Upper bound on epsilon over all tilts.

        With method extremes it is the largest over the combinations of extreme normals, and is
        attained. It is 0 at a few creases labelled M, whose label comes from another grasp, which
        is better over the best normals.
        """
        return self.epsilon_range.maximum

    @property
    def holding(self) -> Holding | None:
        """Grip force and payload of the grasps under the load; None: there is no load.

        Computed when first read.
        """
        return None if self.deferred_holding is None else self.deferred_holding.value

    def compute_labels(self, progress: Progress) -> None:
        """Compute `label` now, which takes time with method extremes only.

        Args:
            progress: Called with the fraction of the work done, from 0 to 1.

        Raises:
            SettingError: A grasp has too many combinations of extreme normals.
        """
        if self.model.method == "extremes" and self.deferred_label.computed is None:
            self.deferred_label.compute(progress)
            progress(1.0)

    def compute_epsilon(self, progress: Progress) -> None:
        """Compute `epsilon_range` now.

        Args:
            progress: Called with the fraction of the work done, from 0 to 1.
        """
        self.deferred_epsilon.compute(progress)

    def compute_holding(self, progress: Progress) -> None:
        """Compute `holding` now, if there is a load.

        Args:
            progress: Called with the fraction of the work done, from 0 to 1.
        """
        if self.deferred_holding is not None:
            self.deferred_holding.compute(progress)
