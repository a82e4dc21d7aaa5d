"""Contacts that are evaluated in parts: what reports need of all grasps, and few of them whole."""

from collections import defaultdict
from collections.abc import Iterable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.grasps.evaluation import evaluate_contacts
from grasp3d.grasps.ranking import listed_rows, stated_label
from grasp3d.grasps.verdict import HoldingVerdict, Verdict, deciding_rows, verdict_of
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.holding import Holding
from grasp3d.system.context import within

LISTED = 10
"""Best grasps that are kept of each part."""

OF_ALL = ("label", "critical_angle", "margin", "distance")
FORCES = ("grip_force", "grip_force_least", "grip_force_largest", "payload", "resistance")
"""What is kept of all grasps; under a load also of their `Holding`."""

TYPES = {"label": "u1", "resistance": "u1", "rows": "i8", **dict.fromkeys(OF_ALL[1:], "f4")}
"""NumPy types in which it is kept, f8 else: one buffer each, as many arrays would be scattered."""

EPSILON_FROM = 0.7
"""Fraction of the work on a part after which epsilon is measured."""


class EvaluatedParts:
    """All grasps of the parts so far, of which few are kept whole.

    Args:
        mesh: The object.
        model: Friction and sensor resolution, with as many fingers as the grasps have contacts.
        options: `max_distance` and `load`, as in `evaluate_grasps`.
    """

    def __init__(self, mesh: ObjectMesh, model: GraspModel, **options: Any) -> None:
        self.mesh, self.model, self.size = mesh, model, 0
        self._options, self._sure = options, 0
        self._values: dict[str, bytearray] = defaultdict(bytearray)
        self._last: GraspTable | None = None

    def evaluate(self, parts: Iterable[tuple[float, Floats]]) -> Iterator[GraspTable]:
        """Evaluate the grasps of each part, when it is needed, and report the progress.

        Args:
            parts: From `contact_parts`.

        Raises:
            ContactError, SettingError: As `evaluate_grasps` does.
        """
        done = 0.0
        for fraction, contacts in parts:
            with within(done, fraction):
                grasps = self._evaluated(contacts)
            done = fraction
            self._keep(grasps, contacts)
            yield grasps

    def _evaluated(self, contacts: Floats) -> GraspTable:
        with within(0.0, EPSILON_FROM):
            grasps = evaluate_contacts(
                self.mesh, contacts, self.model, first=self.size, **self._options
            )
        with within(EPSILON_FROM, 1.0):
            grasps.compute("epsilon_range")
        return grasps

    def _keep(self, grasps: GraspTable, contacts: Floats) -> None:
        rows = np.union1d(listed_rows(grasps, LISTED), deciding_rows(grasps))
        kept = {name: getattr(grasps, name) for name in OF_ALL}
        kept |= {"rows": self.size + rows, "contacts": contacts[rows]}
        if grasps.holding is not None:
            kept |= {name: getattr(grasps.holding, name) for name in FORCES}
        for name, values in kept.items():
            self._values[name] += values.astype(TYPES.get(name, "f8")).tobytes()
        self._sure += int(np.sum(stated_label(grasps) == Label.S))
        self.size += grasps.size
        self._last = grasps

    def all(self, name: str) -> Any:
        """Values of all grasps: `label`, `critical_angle`, `margin`, or `distance` of contacts."""
        return np.frombuffer(self._values[name], TYPES.get(name, "f8"))

    @property
    def critical_angle(self) -> Floats:
        """Of all grasps [rad], shape (b,)."""
        return np.asarray(self.all("critical_angle"))

    @property
    def margin(self) -> Floats:
        """Of all grasps [rad], shape (b,)."""
        return np.asarray(self.all("margin"))

    @property
    def holding(self) -> Holding | None:
        """Of all grasps; None: there is no load."""
        one = None if self._last is None else self._last.holding
        return None if one is None else replace(one, **{name: self.all(name) for name in FORCES})

    def few(self) -> tuple[GraspTable, Ints]:
        """All grasps of a single part, else the best of every part; and their rows in the file."""
        if self._last is not None and self._last.size == self.size:
            return self._last, np.arange(self.size)
        contacts = self.all("contacts").reshape(-1, self.model.fingers, 3)
        grasps = evaluate_contacts(self.mesh, contacts, self.model, **self._options)
        return grasps, self.all("rows")

    def verdict(self, few: GraspTable, holding: Holding | None) -> Verdict:
        """The verdict on all grasps, from those of `few` and `holding`."""
        load = None if holding is None else HoldingVerdict.of(holding)
        return replace(verdict_of(few), count=self._sure, of=self.size, holding=load)
