"""What has to be computed for what is chosen: the next piece of work, and nothing that is known."""

import math
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from grasp3d.settings import GraspModel, Sampling
from grasp3d.viewer.session.painting import is_of
from grasp3d.viewer.session.saving import written
from grasp3d.viewer.session.searching import measured, prepared, scanned, searched
from grasp3d.viewer.session.state import Places, Shown
from grasp3d.viewer.session.work import Job
from grasp3d.viewer.subjects.subject import Subject

if TYPE_CHECKING:
    from collections.abc import Callable

    from grasp3d.system.progress import Progress
    from grasp3d.viewer.session.album import Exhibit

PAUSE = 0.4
"""How long a slider must rest before a search for it begins [s]."""

Work: TypeAlias = Job[Subject]


@dataclass(frozen=True, eq=False)
class Viewed:
    """The object that is looked at, as far as it is ready."""

    number: int
    exhibit: "Exhibit"
    subject: Subject | None = None
    """None: it is being opened."""
    scan: Subject | None = None
    """The same with fingers fixed."""
    fixed: Places = ()
    """Which fingers those are."""

    @property
    def current(self) -> Subject | None:
        """The surface that is shown."""
        return self.scan or self.subject


@dataclass(frozen=True, eq=False)
class Saving:
    """A file that is to be written of what was shown when it was asked for."""

    path: Path
    subject: Subject
    model: GraspModel


def wanted(
    viewed: Viewed, shown: Shown, sampling: Sampling, saving: Saving | None = None
) -> Work | None:
    """Say what has to be computed next; None: nothing.

    The first word of a job's key says what it is: open, save, scan, search, grasps or epsilon; the
    rest all that its result depends on.

    Args:
        viewed: What there is.
        shown: What is chosen.
        sampling: How grasps are searched, but for what is chosen.
        saving: What is to be written.
    """
    subject, number = viewed.subject, viewed.number
    if subject is None:
        return Job(("open", number), f"opening {viewed.exhibit.name}", viewed.exhibit.open)
    if saving is not None:
        do = partial(written, saving.subject, saving.model, saving.path)
        return Job(("save", number, saving.path, saving.model), f"saving {saving.path.name}", do)
    if shown.fixed:
        if viewed.scan is None or viewed.fixed != shown.fixed:
            do = partial(scanned, subject, shown.model, shown.fixed)
            return Job(("scan", number, shown.fixed), "scanning", do)
        return _epsilon(viewed.scan, shown, number)
    search = within_reach(sampling, shown)
    wide = not _covers(subject, shown)
    if wide or is_other(subject, shown, sampling):
        key = ("search", number, shown.model.fingers, search, wide)
        do = partial(searched, subject, shown.model, search, wide=wide)
        return Job(key, "searching grasps", do, PAUSE)
    return _grasps(subject, shown, number) or _epsilon(subject, shown, number)


def is_other(subject: Subject, shown: Shown, sampling: Sampling) -> bool:
    """Whether a surface belongs to other fingers or limits than are chosen.

    Args:
        subject: The surface as it is known.
        shown: What is chosen.
        sampling: How grasps are searched, but for what is chosen.
    """
    if subject.model.fingers != shown.model.fingers:
        return True
    if subject.sampling is None:  # a scan, whose grasps are given
        return False
    asked, had = within_reach(sampling, shown), subject.sampling
    return replace(asked, search_angle=None) != replace(had, search_angle=None)


def is_stale(viewed: Viewed, shown: Shown, sampling: Sampling) -> bool:
    """Whether what is shown belongs to other fingers, limits or fixed fingers than are chosen.

    A search that did not go far enough is no reason: what it leaves open is grey.

    Args:
        viewed: What there is.
        shown: What is chosen.
        sampling: How grasps are searched, but for what is chosen.
    """
    if viewed.subject is None:
        return False
    if shown.fixed:
        return viewed.scan is None or viewed.fixed != shown.fixed
    return is_other(viewed.subject, shown, sampling)


def awaited(subject: Subject, shown: Shown) -> str:
    """What has to be searched where a surface is stale, in words."""
    fingers = shown.model.fingers
    if shown.fixed:
        count = len(shown.fixed)
        return f"labels for {count} fixed {'finger' if count == 1 else 'fingers'}"
    if subject.model.fingers != fingers:
        return f"grasps for {fingers} fingers"
    limit = "largest opening" if fingers == 2 else "reach"
    return f"grasps for this {limit}"


def reach_of(sampling: Sampling, model: GraspModel) -> float:
    """How far apart contacts may be."""
    return sampling.max_opening if model.fingers == 2 else sampling.max_spread


def within_reach(sampling: Sampling, shown: Shown) -> Sampling:
    """The search that is asked for; limits of another number of fingers fall away."""
    usual, reach = Sampling(), shown.max_opening
    if shown.model.fingers == 2:
        return replace(
            sampling, max_opening=reach, min_opening=min(sampling.min_opening, reach),
            candidates=usual.candidates, min_separation=None, max_spread=math.inf,
            candidate_points=usual.candidate_points, seed=usual.seed,
        )  # fmt: skip
    apart = sampling.min_separation
    return replace(
        sampling, max_spread=reach, rays=usual.rays, grip=usual.grip, min_opening=0.0,
        max_opening=math.inf, min_separation=None if apart is None else min(apart, reach),
    )  # fmt: skip


def _covers(subject: Subject, shown: Shown) -> bool:
    """Whether the search went as far as both resolutions ask that are shown."""
    compared = shown.model.sensor_resolution if shown.compare is None else shown.compare
    other = replace(shown.model, sensor_resolution=compared)
    return subject.covers(shown.model) and subject.covers(other)


def _grasps(subject: Subject, shown: Shown, number: int) -> Work | None:
    """Finding the grasps of a file, where a vertex is told of or epsilon is painted.

    A file that names the partners needs its mesh only to tell of epsilon at another model.
    """
    if subject.labels is not None or not subject.measurable:
        return None
    known = subject.epsilons
    another = known is None or not is_of(known.model, shown.model)
    if shown.vertex is None and not (another and _paints_epsilon(shown)):
        return None
    do: Callable[[Progress], Subject]
    if subject.partners is None:
        sampling = replace(subject.sampling or Sampling(), search_angle=min(
            subject.cone, math.pi / 2.0))  # fmt: skip
        do = partial(searched, subject, subject.model, sampling)
        return Job(("grasps", number), "searching grasps", do)
    return (
        Job(("grasps", number), "preparing grasps", partial(prepared, subject))
        if another
        else (None)
    )


def _epsilon(subject: Subject, shown: Shown, number: int) -> Work | None:
    """The work of measuring epsilon, where it is painted and not known for what is asked."""
    known = subject.epsilons
    if not _paints_epsilon(shown) or not subject.measurable:
        return None
    if known is not None and is_of(known.model, shown.model):
        return None
    asked = replace(shown.model, fingers=subject.model.fingers)
    key = ("epsilon", number, asked, shown.fixed, shown.max_opening)
    return Job(key, "measuring ε", partial(measured, subject, asked), PAUSE)


def _paints_epsilon(shown: Shown) -> bool:
    return shown.paint in {"epsilon", "epsilon_min"}
