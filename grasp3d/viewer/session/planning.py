"""The next computation that the current choices need."""

from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, TypeAlias

from grasp3d.pictures.colors import QUANTITIES, same_settings
from grasp3d.pictures.subject import Subject
from grasp3d.settings import GraspModel, Sampling
from grasp3d.system.counts import noun
from grasp3d.viewer.session.background import Job
from grasp3d.viewer.session.computations import (
    compute_epsilon,
    compute_forces,
    scan_with_fixed,
    search_grasps,
    search_wider,
    write_labels,
)
from grasp3d.viewer.session.state import FixedPoints, ViewState

if TYPE_CHECKING:
    from grasp3d.viewer.session.collection import Item

DELAY = 0.4
"""Delay between the last change of a slider and the search for it [s]."""

SubjectJob: TypeAlias = Job[Subject]

COMPUTED = {
    "epsilons": ("computing ε", compute_epsilon),
    "forces": ("computing grip forces", compute_forces),
}
"""How what colours show is computed, by the field of the subject that holds it."""


@dataclass(frozen=True, eq=False)
class ViewedItem:
    """The current object, as far as it is available."""

    number: int
    item: "Item"
    subject: Subject | None = None
    """None: it is being opened."""
    scan: Subject | None = None
    """The same surface with fingers fixed."""
    fixed: FixedPoints = ()
    """Contact points of the fixed fingers of `scan`."""

    @property
    def current(self) -> Subject | None:
        """The surface that is displayed."""
        return self.scan or self.subject


@dataclass(frozen=True, eq=False)
class SaveRequest:
    """A file to write, with the surface and model at the time of the request."""

    path: Path
    subject: Subject
    model: GraspModel


def next_job(
    viewed: ViewedItem, state: ViewState, sampling: Sampling, saving: SaveRequest | None = None
) -> SubjectJob | None:
    """The next job; None: everything is computed.

    The first word of a job's key is its kind: open, save, scan, search, wider,
    epsilons or forces; the rest is all that its result depends on.

    Args:
        viewed: The current object.
        state: The user's choices.
        sampling: Search settings, apart from those in `state`.
        saving: A file to write, if any.
    """
    subject, number = viewed.subject, viewed.number
    if subject is None:
        return Job(("open", number), f"opening {viewed.item.name}", viewed.item.open)
    if saving is not None:
        run = partial(write_labels, saving.subject, saving.model, saving.path)
        return Job(("save", number, saving.path, saving.model), f"saving {saving.path.name}", run)
    if subject.poses is not None:
        return None
    if state.fixed:
        if viewed.scan is None or viewed.fixed != state.fixed:
            run = partial(scan_with_fixed, subject, state.model, state.fixed)
            return Job(("scan", number, state.fixed), "scanning", run)
        return _numbers_job(viewed.scan, state, number)
    return _search_job(subject, state, sampling, number) or _numbers_job(subject, state, number)


def needs_search(subject: Subject, state: ViewState, sampling: Sampling) -> bool:
    """Whether a surface was searched for another number of fingers or other limits.

    Args:
        subject: The surface.
        state: The user's choices.
        sampling: Search settings, apart from those in `state`.
    """
    if subject.labels.model.fingers != state.model.fingers:
        return True
    if subject.labels.sampling is None:  # a scan, whose grasps are given
        return False
    needed, searched = sampling_for(sampling, state), subject.labels.sampling
    return _limits(subject, needed) != _limits(subject, searched)


def _limits(subject: Subject, sampling: Sampling) -> Sampling:
    """Settings of a search without its cone, with openings that a gripper can have."""
    sampling = replace(sampling, search_angle=None)
    scene = subject.labels.scene
    if scene is None or subject.labels.model.fingers > 2:
        return sampling
    least, most = scene.hand.limits
    most = min(sampling.max_opening, most)
    return replace(
        sampling, min_opening=min(max(sampling.min_opening, least), most), max_opening=most
    )


def is_stale(viewed: ViewedItem, state: ViewState, sampling: Sampling) -> bool:
    """Whether the displayed surface has other fingers, limits or fixed fingers than are chosen.

    A surface whose search did not go far enough is not stale: its unknown part is grey.

    Args:
        viewed: The current object.
        state: The user's choices.
        sampling: Search settings, apart from those in `state`.
    """
    subject = viewed.subject
    if subject is None:
        return False
    if state.fixed:
        return viewed.scan is None or viewed.fixed != state.fixed
    return needs_search(subject, state, sampling)


def model_for(subject: Subject, state: ViewState) -> GraspModel:
    """The chosen friction and resolution, with a surface's number of fingers."""
    model, fingers = state.model, subject.labels.model.fingers
    # A copy checks all settings again, which takes longer than the labels of a small surface.
    return model if model.fingers == fingers else replace(model, fingers=fingers)


def missing_result(state: ViewState) -> str:
    """Name of the result that a stale surface lacks, for messages."""
    fingers = state.model.fingers
    if state.fixed:
        return f"labels for {len(state.fixed)} fixed {noun(len(state.fixed), 'fingers')}"
    return f"grasps for {fingers} fingers"


def sampling_for(sampling: Sampling, state: ViewState) -> Sampling:
    """Search settings for the chosen fingers; more than two squeeze."""
    return sampling if state.model.fingers == 2 else replace(sampling, grip="squeeze")


def _search_job(
    subject: Subject, state: ViewState, sampling: Sampling, number: int
) -> SubjectJob | None:
    """Search for other fingers or limits, or a wider cone."""
    search = sampling_for(sampling, state)
    wide = not subject.covers(state.model)
    if needs_search(subject, state, sampling):
        key = ("search", number, state.model.fingers, search, wide)
        run = partial(search_grasps, subject, state.model, search, wide=wide)
        return Job(key, "searching grasps", run, DELAY)
    if wide:
        run = partial(search_wider, subject, state.model, search)
        return Job(("wider", number, search), "searching grasps", run, DELAY)
    return None


def _numbers_job(subject: Subject, state: ViewState, number: int) -> SubjectJob | None:
    """Compute epsilon or grip forces, if they are shown and not known for the chosen model."""
    source = "" if state.paint == "label" else QUANTITIES[state.paint].source
    if not source or QUANTITIES[state.paint].problem_of(subject):
        return None
    text, compute = COMPUTED[source]
    known = getattr(subject, source)
    if known is not None and same_settings(known.model, state.model):
        return None
    model = model_for(subject, state)
    key = (source, number, model, state.fixed)
    return Job(key, text, partial(compute, subject, model), DELAY)
