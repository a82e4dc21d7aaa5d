"""Labels, margins and scores that follow from the angles, epsilon and forces of grasps.

The score is the one number by which lists and files are sorted.
"""

import math
from functools import cached_property
from importlib import import_module
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.stability.label import Label, max_resolution
from grasp3d.surface.load_case import input_warnings
from grasp3d.system.context import report_progress

if TYPE_CHECKING:
    from grasp3d.hand.scene import Scene
    from grasp3d.mesh import ObjectMesh
    from grasp3d.quality.force_ranges import EpsilonRange
    from grasp3d.quality.loads import Load
    from grasp3d.settings import GraspModel
    from grasp3d.surface.load_case import LoadResult


def written_scores(label: Bytes, quality: Floats) -> Floats:
    """Scores (l + (1 + s) / 2) / 3, from 0 to 1: U up to 1/3, M up to 2/3, S above; shape (b,).

    Args:
        label: `Label` codes l that take everything stated into account: U 0, M 1, S 2.
        quality: How far each grasp is from failing, s, from -1 to 1.
    """
    return locked((label + 0.5 * (1.0 + np.clip(quality, -1.0, 1.0))) / 3.0)


def quality_of_contacts(margin: Floats, held: Floats) -> Floats:
    """How far contacts are from failing, from -1 to 1, shape (b,).

    Margin over pi where it is negative, else m / (1 + m).

    Args:
        margin: Margin of the grasps [rad].
        held: Ratio m of what they hold to what must be held, or epsilon where it is not known.
    """
    with np.errstate(divide="ignore"):
        share = 1.0 - 1.0 / (1.0 + np.nan_to_num(held, nan=0.0, posinf=math.inf))
    return np.where(margin < 0.0, np.maximum(margin / math.pi, -1.0), share)


class LabelledGrasps:
    """Grasps, one for each row of the arrays, with what follows from their angles and epsilon."""

    if TYPE_CHECKING:  # fields and attributes of the subclasses

        @property
        def mesh(self) -> ObjectMesh: ...  # noqa: D102
        @property
        def scene(self) -> Scene | None: ...  # noqa: D102
        @property
        def load(self) -> Load | None: ...  # noqa: D102
        @property
        def model(self) -> GraspModel: ...  # noqa: D102
        @property
        def label(self) -> Bytes: ...  # noqa: D102
        @property
        def critical_angle(self) -> Floats: ...  # noqa: D102
        @property
        def epsilon_range(self) -> EpsilonRange: ...  # noqa: D102
        def to_table(self) -> Any: ...  # noqa: D102
        @property
        def load_result(self) -> LoadResult | None: ...  # noqa: D102

    def mask(self, letters: str) -> Bools:
        """Mask of the grasps whose label is one of some letters, shape as `label`.

        Args:
            letters: One or several of S, M and U: 'S', 'SM'.

        Raises:
            SettingError: There is another letter, or none.
        """
        unknown = sorted(set(letters) - set(Label.__members__))
        if unknown or not letters:
            raise SettingError(f"letters must be some of S, M and U; got {letters!r}")
        return np.isin(self.label, [Label[letter] for letter in letters])

    @property
    def warnings(self) -> tuple[str, ...]:
        """What may make the results wrong, one sentence each.

        These are warnings of the mesh, of a size that is implausible for the mass or the gripper,
        and of lengths that are probably in another unit than the mesh. The command line refuses
        such lengths unless `--force` is given, and all warnings with `--strict`.
        """
        own = self.model, getattr(self, "sampling", None)
        return input_warnings(self.mesh, self.scene, self.load, *own)

    def computed(self, name: str) -> Any:
        """Value of an attribute (`label`, `epsilon_range`, ...) if it is computed already, or None.

        Args:
            name: An attribute that is computed when it is first read.
        """
        return vars(self).get(name)

    def compute_labels(self) -> None:
        """Compute `label` now; this takes time with method extremes only.

        Raises:
            SettingError: A grasp has too many combinations of extreme normals.
        """
        if self.model.method == "extremes" and self.computed("label") is None:
            _ = self.label
            report_progress(1.0)

    @property
    def letter(self) -> Bytes:
        """`Label` codes that take everything stated into account; without a load, `label`.

        With a load whose mass and force are known, they say whether it is held; if its weight may
        act in any direction, they are at most `label`. If mass or force is not known, a grasp that
        no force surely makes hold the load is M at most, and U if no force does at any normals.
        """
        load_result = self.load_result
        if load_result is None:
            return self.label
        if load_result.label is not None:
            # Only contacts that are force-closed as points resist forces in all directions.
            most = self.label if load_result.case.task.in_all_directions else load_result.label
            return locked(np.minimum(load_result.label, most))
        most = np.where(np.isfinite(load_result.grip_force_largest), Label.S, Label.M)
        most[~np.isfinite(load_result.grip_force_least)] = Label.U
        return locked(np.minimum(self.label, most).astype(np.uint8))

    @cached_property
    def quality(self) -> Floats:
        """How far each grasp is from failing, from -1 to 1; see `quality_of_contacts`."""
        load_result, held = self.load_result, self.epsilon
        if load_result is not None and load_result.has_payload and load_result.mass:
            held = load_result.payload / load_result.mass
        return locked(quality_of_contacts(self.margin, held))

    @cached_property
    def score(self) -> Floats:
        """Score of each grasp, from 0 to 1: ordered by letter, and within a letter by quality.

        Lists are sorted by it, and every file states it; see `written_scores`.
        """
        return written_scores(self.letter, self.quality)

    @cached_property
    def margin(self) -> Floats:
        """Margin of the grasps [rad]: beta - alpha/2 - beta*, less all other uncertainties.

        A grasp is S iff it is above 0 (with method exact). By this angle friction may be smaller,
        or normals less certain, before it is no longer S. -inf where there is no grasp.
        """
        return locked(self.model.sure_angle - self.critical_angle)

    @cached_property
    def max_resolution(self) -> Floats:
        """Coarsest sensor resolution below which the grasp is S [rad]; 0: none is fine enough.

        The other uncertainties of the model stay as they are.
        """
        return locked(max_resolution(self.critical_angle, self.model))

    @cached_property
    def epsilon(self) -> Floats:
        """Epsilon of the grasps (Ferrari & Canny 1992).

        Computed at the contacts' nominal normals (on creases the middle of the set), about the
        mesh's centre of mass, with torques divided by `mesh.torque_scale`, in the span of the
        wrenches. A certified lower bound within 1 %. 0 where the grasp is not force-closed, nan
        where there is no grasp or the normals at a contact cancel out.
        """
        return self.epsilon_range.nominal

    @cached_property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts within the sensor's resolution.

        `model.tilts` says how it is computed: 'exact', over 'sampled_tilts' with method extremes,
        or as a 'bound' for soft fingers; see `quality.epsilon_range`.
        """
        return self.epsilon_range.minimum

    @cached_property
    def epsilon_max(self) -> Floats:
        """Upper bound on epsilon over all tilts.

        With method extremes it is the largest value over the combinations of extreme normals, which
        is attained.
        """
        return self.epsilon_range.maximum

    @property
    def grip_force(self) -> Floats | None:
        """Force that each finger needs under the load [N]; None: there is no load.

        See `LoadResult.grip_force`.
        """
        return None if self.load_result is None else self.load_result.grip_force

    @property
    def payload(self) -> Floats | None:
        """Mass that the available force holds [kg]; None: there is no load.

        See `LoadResult.payload`.
        """
        return None if self.load_result is None else self.load_result.payload

    def show(self, **options: Any) -> Any:
        """Show the object: in a notebook as a page below the cell, elsewhere in a window.

        For grasps, the viewer's buttons for the next and the previous object go through them. The
        colours are the labels that the first finger would have elsewhere, with the other fingers
        unmoved.

        Args:
            options: As in `grasp3d.viewer.show.show`: settings, height, proxy.

        Raises:
            OutputError: Nothing can be shown in this environment.
        """
        # The viewer belongs to a higher layer and is slow to import, so it is imported by name when
        # it is needed, as pandas does with its plotting backends.
        return import_module("grasp3d.viewer.show").show(self, **options)

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
