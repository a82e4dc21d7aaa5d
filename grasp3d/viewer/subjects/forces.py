"""Grip force and payload of every vertex's grasp, as far as they are known."""

from dataclasses import dataclass

from grasp3d.arrays import Bytes, Floats, short_repr
from grasp3d.settings import GraspModel
from grasp3d.surface.holding import Holding
from grasp3d.surface.load_case import LoadCase


@dataclass(frozen=True)
class LoadNumbers:
    """What a load comes to on an object."""

    mass: float | None
    """[kg]; None: not given, forces are those for 1 kg if the task depends on the mass."""
    available: float | None
    """Force at hand of each finger [N]; None: not given."""
    by_mass: bool = True
    """Whether the task depends on the mass; given wrenches alone do not."""

    @classmethod
    def of(cls, case: LoadCase) -> "LoadNumbers":
        """What a load comes to on an object."""
        return cls(case.mass, case.available, case.task.mass is not None)

    def __str__(self) -> str:
        text = self.task
        return text if self.available is None else f"{text}, {self.available:.3g} N at hand"

    @property
    def task(self) -> str:
        """What must be held, in a few words."""
        if not self.by_mass:
            return "given wrenches"
        return "1 kg (no mass is given)" if self.mass is None else f"{self.mass:.3g} kg"

    @property
    def decided(self) -> bool:
        """Whether the task is that of the object: its mass is known, or does not matter."""
        return self.mass is not None or not self.by_mass


@dataclass(frozen=True, eq=False)
class Forces:
    """Grip force and payload of every vertex's grasp, for one friction and resolution."""

    grip_force: Floats
    """That each finger needs [N]; inf: none suffices; nan: no grasp. (V,)"""
    grip_force_least: Floats
    """At the best normals within the sensor's resolution, (V,)."""
    grip_force_largest: Floats
    """At the worst of them, (V,)."""
    payload: Floats
    """[kg]; nan: no grasp, or no force at hand. (V,)"""
    model: GraspModel
    """Model for which they were computed."""
    resistance: Bytes | None = None
    """`Resistance` codes, (V,); None: unknown."""

    __repr__ = short_repr

    @classmethod
    def of(cls, holding: Holding, model: GraspModel) -> "Forces":
        """The forces that were computed for a model."""
        return cls(
            holding.grip_force,
            holding.grip_force_least,
            holding.grip_force_largest,
            holding.payload,
            model,
            holding.resistance,
        )
