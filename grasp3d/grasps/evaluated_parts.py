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
from grasp3d.system.context import begin_step, within

LISTED = 10
"""Best grasps that are kept of each part."""

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
        self._options = options
        self._values: dict[str, list[Any]] = defaultdict(list)
        self._holdings: list[Holding] = []
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
        begin_step("measuring epsilon")
        with within(EPSILON_FROM, 1.0):
            grasps.compute("epsilon_range")
        return grasps

    def _keep(self, grasps: GraspTable, contacts: Floats) -> None:
        rows = np.union1d(listed_rows(grasps, LISTED), deciding_rows(grasps))
        numbers = {"critical_angle", "margin", "distance"}
        kept = {name: getattr(grasps, name).astype(np.float32) for name in numbers}
        kept |= {"label": grasps.label, "rows": self.size + rows, "contacts": contacts[rows]}
        kept["sure"] = np.array([np.sum(stated_label(grasps) == Label.S)])
        for name, values in kept.items():
            self._values[name].append(values)
        self._holdings += [] if grasps.holding is None else [grasps.holding]
        self.size += grasps.size
        self._last = grasps

    def all(self, name: str) -> Any:
        """Values of all grasps: `label`, `critical_angle` or `margin` (b,), `distance` (b, n)."""
        return np.concatenate(self._values[name])

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
        return self._holdings[0].followed_by(self._holdings[1:]) if self._holdings else None

    def few(self) -> tuple[GraspTable, Ints]:
        """All grasps of a single part, else the best of every part; and their rows in the file."""
        if self._last is not None and self._last.size == self.size:
            return self._last, np.arange(self.size)
        grasps = evaluate_contacts(self.mesh, self.all("contacts"), self.model, **self._options)
        return grasps, self.all("rows")

    def verdict(self, few: GraspTable, holding: Holding | None) -> Verdict:
        """The verdict on all grasps, from those of `few` and `holding`."""
        load = None if holding is None else HoldingVerdict.of(holding)
        count = int(self.all("sure").sum())
        return replace(verdict_of(few), count=count, of=self.size, holding=load)
