"""Settings of a batch: how meshes are labelled, and how their surfaces are stored."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from grasp3d.errors import SettingError
from grasp3d.hand.hand import Hand
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions, Sampling, check_search_settings
from grasp3d.settings.checks import check_range
from grasp3d.settings.mesh_options import Mask

Surfaces = Literal["auto", "ply", "tar", "none"]

OF_TABLES = {
    "scale": "mesh", "unit": "mesh", "max_edge": "mesh", "repair": "mesh", "center_of_mass": "mesh",
    "friction": "model", "hand": "reach", "table": "reach", "up": "reach", "mass": "load",
}  # fmt: skip
"""Settings that a table of meshes may state for each mesh, and the group of each setting."""


@dataclass(frozen=True)
class BatchSettings:
    """Settings with which all meshes are labelled, or for which they are checked.

    Each group of settings may also be a dict of fields, and the load a mass, '0.5kg'.

    Attributes:
        sampling: Settings of the search for grasps.
        reach: The gripper that must reach each grasp, and the table.
        load: What each grasp must hold, and with which force; None: nothing.
        more_hands: Further hands; each mesh is labelled for the hand of `reach` and for each of
            these. Rows and files are named after hand and mesh, 'franka/mug.stl'.
        best: Number of best distinct grasps that the row of each mesh keeps; 0: none, and no
            verdict, for which the jaws close at hundreds of poses.
    """

    model: GraspModel = field(default_factory=GraspModel)
    sampling: Sampling = field(default_factory=Sampling)
    mesh: MeshOptions = field(default_factory=MeshOptions)
    best: int = 5
    reach: ReachSettings = field(default_factory=ReachSettings)
    load: Load | None = None
    more_hands: tuple[Hand, ...] = ()

    def __post_init__(self) -> None:
        kinds: dict[str, Any] = {
            "model": GraspModel, "sampling": Sampling, "mesh": MeshOptions,
            "reach": ReachSettings, "load": Load,
        }  # fmt: skip
        for name, kind in kinds.items():
            given = kind.given(name, getattr(self, name))
            object.__setattr__(self, name, given if name == "load" else given or kind())
        check_range("the number of best grasps", self.best, 0)
        if self.reach.pose_error and not self.best:
            raise SettingError("a pose error applies to the best grasps; ask for at least one")
        if isinstance(self.mesh.region, Mask):
            raise SettingError(f"{self.mesh.region} belongs to one mesh; a library takes a box")
        check_search_settings(self.model, self.sampling)
        for hand in self.hands:
            hand.check_fingers(self.model.fingers)
        names = [hand.name for hand in self.hands]
        if self.more_hands and (self.reach.hand is None or len({*names}) < len(names)):
            raise SettingError(
                "more_hands (--more-hands) takes further hands beside that of reach (--hand), with "
                "names of their own; got "
                f"{', '.join(names)}"
            )

    @property
    def hands(self) -> tuple[Hand, ...]:
        """All hands."""
        return tuple(filter(None, (self.reach.hand, *self.more_hands)))

    def of_mesh(self, own: Mapping[str, Any]) -> "BatchSettings":
        """Return the settings of one mesh.

        Args:
            own: Settings stated for this mesh alone, by the names in `OF_TABLES`.

        Raises:
            SettingError: A value is invalid, or contradicts the other settings.
        """
        changed = {name: getattr(self, name) for name in {OF_TABLES[key] for key in own}}
        for name, settings in changed.items():
            mine = {key: value for key, value in own.items() if OF_TABLES[key] == name}
            changed[name] = Load(**mine) if settings is None else replace(settings, **mine)
        return replace(self, more_hands=(), **changed) if own else self
