"""State of one viewer, without its display: choices, displayed surface, background job."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.errors import SettingError
from grasp3d.grasps.best import best_grasps, first_vertices, has_poses
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.scene import Scene
from grasp3d.pictures.colors import QUANTITIES
from grasp3d.pictures.subject import NO_LABELS, Subject
from grasp3d.pictures.view_settings import Paint, ViewSettings
from grasp3d.settings import MAX_SEARCHED_FINGERS, GraspModel
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.viewer.session.background import Run, Worker
from grasp3d.viewer.session.collection import Collection
from grasp3d.viewer.session.computations import check_savable
from grasp3d.viewer.session.inspection import Inspection, inspect, inspect_given, inspect_pose
from grasp3d.viewer.session.planning import (
    SaveRequest,
    SubjectJob,
    ViewedItem,
    is_stale,
    missing_result,
    model_for,
    needs_search,
    next_job,
)
from grasp3d.viewer.session.state import ViewState, changed_state

if TYPE_CHECKING:
    from collections.abc import Hashable

OF_FINGERS = frozenset({"fingers", "fixed"})
"""Choices that do not apply to them."""

BEST = 20
"""Number of the best grasps of a surface that a user steps through."""

MAX_CACHED = 2
"""Search results of an object that are cached besides the displayed one; a large one takes hundreds
of megabytes."""


class Session:
    """One user's view of a collection.

    A window or page calls `change`, `click`, `step` and so on for the user's actions, and `poll`
    several times a second; it redraws when `revision` has grown. All calls must come from one
    thread.
    """

    def __init__(
        self,
        collection: Collection,
        settings: ViewSettings | None = None,
        *,
        state: ViewState | None = None,
        number: int = 0,
    ) -> None:
        """Open an object.

        Args:
            collection: The objects.
            settings: Initial view; None: the default.
            state: Initial choices; None: those of the collection and the settings.
            number: Index of the object in the collection.
        """
        settings = settings or ViewSettings()
        self.collection = collection
        self.settings = settings
        self.state = state or ViewState(
            model=collection.model,
            paint=settings.paint,
            vertex=settings.vertex,
        )
        self.revision = 0
        self.steps = 0
        """Number of steps to other grasps so far, to each of which the camera turns."""
        self._message = ""
        self._viewed = ViewedItem(number, collection.items[number])
        self._worker: Worker[Subject] = Worker()
        self._failed: dict[Hashable, str] = {}
        self._saving: SaveRequest | None = None
        self._cached: list[Subject] = []
        self._last_inspection: tuple[Subject, tuple[object, ...], Inspection] | None = None
        self._start_next_job()

    @property
    def number(self) -> int:
        """Index of the current object in the collection, from 0."""
        return self._viewed.number

    @property
    def name(self) -> str:
        """Name of the current object."""
        return self._viewed.item.name

    @property
    def subject(self) -> Subject | None:
        """The displayed surface; None: it is being opened, or cannot be opened."""
        return self._viewed.current

    @property
    def stale(self) -> bool:
        """Whether the surface has other fingers, limits or fixed fingers than are chosen.

        This lasts until the right grasps are searched; meanwhile no results are displayed.
        """
        return is_stale(self._viewed, self.state, self.collection.sampling)

    @property
    def model(self) -> GraspModel:
        """Chosen friction and resolution, with the displayed surface's number of fingers."""
        subject = self.subject
        return self.state.model if subject is None else model_for(subject, self.state)

    @property
    def working(self) -> tuple[str, float] | None:
        """Description and finished fraction (0 to 1) of the background job; None: idle."""
        job = self._worker.job
        return None if job is None else (job.text, self._worker.fraction)

    @property
    def saving(self) -> bool:
        """Whether a file is being written, or will be."""
        return self._saving is not None

    @property
    def message(self) -> str:
        """The last message, or the reason why the current choices could not be computed."""
        return self._message or self.failure

    @property
    def failure(self) -> str:
        """Why the current choices could not be computed; empty if they could."""
        job = self._next_job()
        return "" if job is None else self._failed.get(job.key, "")

    @property
    def inspection(self) -> Inspection | None:
        """The inspected vertex, or the given grasp.

        None: no vertex is chosen, or its grasp is not known yet.
        """
        subject, vertex, model = self.subject, self.state.vertex, self.model
        if subject is None or self.stale:
            return None
        shown = subject.poses
        if shown is None and vertex is None and self.state.grasp is not None:
            shown = self._best_poses(subject, self.state.grasp)
        if vertex is None and shown is None:
            return inspect_given(subject, model)
        last = self._last_inspection
        key = (vertex, self.state.grasp, model)
        if last is None or last[0] is not subject or last[1] != key:
            if shown is not None:
                found = inspect_pose(shown, model)
            else:
                assert vertex is not None
                found = inspect(subject, vertex, model)
            last = self._last_inspection = (subject, key, found)
        return last[2]

    @property
    def scene(self) -> Scene | None:
        """The gripper and the table of the current object; None: no gripper."""
        subject = self._viewed.subject
        return None if subject is None else subject.labels.scene

    def change(self, **changes: Any) -> None:
        """Change some choices.

        Args:
            changes: Fields of `ViewState`, and those of its model in `OF_MODEL`.

        Raises:
            SettingError: A value is outside its range; nothing is changed.
        """
        state = changed_state(self.state, changes)
        if state.paint != self.state.paint:
            self.check_paint(state.paint)
        subject = self.subject
        of_hand = subject is not None and subject.poses is not None
        if of_hand and OF_FINGERS & changes.keys():
            name = min(OF_FINGERS & changes.keys()).replace("_", " ")
            raise SettingError(f"{name} does not apply to given poses")
        if "fingers" in changes and not 2 <= state.model.fingers <= MAX_SEARCHED_FINGERS:
            raise SettingError(
                f"fingers must be from 2 to {MAX_SEARCHED_FINGERS}; got {state.model.fingers}"
            )
        if state.model.fingers != self.state.model.fingers and self.scene is not None:
            self.scene.hand.check_fingers(state.model.fingers)
        self._set_state(state)

    def click(self, vertex: int | None, *, inspect: bool = False) -> None:
        """Handle a click on a vertex; None: beside the object.

        A click during a search is stored: the vertex is inspected when the search has finished.

        Args:
            vertex: Index of the vertex.
            inspect: Inspect it even if clicks fix fingers.

        Raises:
            SettingError: There is no such vertex.
        """
        subject = self.subject
        if subject is None:
            return
        if vertex is not None and not 0 <= vertex < len(subject.mesh.vertices):
            count = len(subject.mesh.vertices)
            raise SettingError(f"there is no vertex {vertex}; there are {count:,}, from 0")
        if vertex is not None and subject.poses is not None:
            raise SettingError(NO_LABELS)
        if vertex is None or inspect or self.state.click == "inspect":
            self._set_state(replace(self.state, vertex=vertex, grasp=None))
            return
        x, y, z = (float(value) for value in subject.mesh.vertices[vertex])
        others = self.state.fixed[: max(0, self.state.model.fingers - 2)]
        self._set_state(replace(self.state, fixed=(*others, (x, y, z)), vertex=None, grasp=None))

    def step_best(self, by: int) -> None:
        """Inspect another of the best distinct grasps of the surface, cyclically.

        Args:
            by: Number of grasps to go forward, or back.

        Raises:
            SettingError: There is no grasp, or they are still searched.
        """
        subject = self.subject
        if subject is not None and subject.poses is not None:
            self.step(by)
            return
        if subject is None or self.stale:
            raise SettingError("the grasps are not known yet; wait until they are searched")
        best = best_grasps(subject.labels, BEST)
        if not best.size:
            raise SettingError("there is no grasp on this surface")
        row, vertices = self.state.grasp, None
        if isinstance(best, GraspTable):
            vertices = first_vertices(best).tolist()
            row = vertices.index(self.state.vertex) if self.state.vertex in vertices else None
        row = ((-1 if by > 0 else 0) if row is None else row) + by
        self.show_best(row % best.size)

    def show_best(self, row: int) -> None:
        """Inspect one of the best distinct grasps of the surface, from 0."""
        subject = self.subject
        assert subject is not None
        best = best_grasps(subject.labels, BEST)
        self.steps += 1
        if isinstance(best, GraspTable):
            self.click(int(first_vertices(best)[row]), inspect=True)
        else:
            self._set_state(replace(self.state, vertex=None, grasp=row))
        self.show_message(f"{row + 1} of the {best.size} best grasps")

    def _best_poses(self, subject: Subject, row: int) -> EvaluatedPoses | None:
        """One of the best poses of a gripper; None: there is no such one."""
        if not has_poses(subject.labels):
            return None
        best = best_grasps(subject.labels, BEST)
        assert isinstance(best, EvaluatedPoses)
        return best.take(np.array([row])) if row < best.size else None

    def check_gripper(self, *, table: bool = False) -> None:
        """Check that the current object has a gripper.

        Args:
            table: Whether it must also stand on a table.

        Raises:
            SettingError: It has none.
        """
        if self._viewed.subject is None:
            return
        scene = self.scene
        if scene is None:
            raise SettingError("there is no gripper; open the object with one (--hand)")
        if table and scene.table is None:
            raise SettingError("there is no table; open the object with one (--table)")

    def check_paint(self, paint: Paint) -> None:
        """Check that the current object has what colours show.

        Raises:
            SettingError: It has no gripper, or no load.
        """
        subject = self.subject
        if subject is not None and paint != "label" and subject.poses is None:
            problem = QUANTITIES[paint].problem_of(subject)
            if problem:
                raise SettingError(problem)

    def offers(self, paint: Paint) -> bool:
        """Whether the current object has what colours show."""
        if self.subject is None:
            return paint == "label" or QUANTITIES[paint].problem is None
        try:
            self.check_paint(paint)
        except SettingError:
            return False
        return True

    def step(self, by: int) -> None:
        """Go forward or back by some objects of the collection, cyclically."""
        number = (self.number + by) % len(self.collection.items)
        if number == self.number:
            return
        self._viewed = ViewedItem(number, self.collection.items[number])
        self._failed.clear()
        self._cached = []
        self._saving = None
        self.state = replace(self.state, vertex=None, grasp=None, fixed=(), section=None)
        self._go_on()

    def save(self, path: Path) -> None:
        """Write the displayed labels at the chosen friction and resolution, in the background.

        It takes as long as computing epsilon; a message reports the result.

        Args:
            path: File to create or replace.

        Raises:
            GraspError: There are no labels yet, or no format has that suffix.
        """
        self.check_current()
        subject = self.subject
        assert subject is not None
        check_savable(subject, self.model, path)
        self._saving = SaveRequest(path, subject, self.model)
        self._go_on()

    def show_message(self, message: str) -> None:
        """Display a message."""
        self._message = message
        self.revision += 1

    def poll(self) -> bool:
        """Process a finished background job; returns whether there was one."""
        finished = self._worker.take_finished()
        if finished is None:
            return False
        self._process(finished)
        self.revision += 1
        self._start_next_job()
        return True

    def close(self) -> None:
        """Cancel the background job."""
        self._saving = None
        self._worker.request(None)

    def check_current(self) -> None:
        """Check that the displayed surface belongs to the current choices.

        Raises:
            SettingError: There is no surface yet, or its grasps are still searched, or cannot be.
        """
        if self.subject is None:
            raise SettingError("there is nothing to save yet; wait until the grasps are searched")
        if not self.stale:
            return
        missing = missing_result(self.state)
        if self.working is None:
            raise SettingError(f"there are no {missing}; change the settings before saving")
        raise SettingError(
            f"the {missing} are still being searched; save when the search is finished"
        )

    def _set_state(self, state: ViewState) -> None:
        if state == self.state:
            return
        self.state = state
        self._go_on()

    def _go_on(self) -> None:
        """Forget the last message, and start what the choices need."""
        self._message = ""
        self.revision += 1
        self._start_next_job()

    def _process(self, finished: Run[Subject]) -> None:
        """Store the result or the error of a finished job."""
        kind, result = finished.job.key[0], finished.result  # type: ignore[index]
        saving = self._saving if kind == "save" else None
        if saving is not None:
            self._saving = None
            self._message = finished.error or f"saved: {saving.path}"
            if result is not None and self.subject is saving.subject:
                self._replace(result)
        elif result is None:
            self._failed[finished.job.key] = finished.error or "it cannot be computed"
        elif kind == "scan":
            self._viewed = replace(self._viewed, scan=result, fixed=self.state.fixed)
        elif kind in {"epsilons", "forces"}:
            self._replace(result)
        else:
            self._show(result)
            self._check_vertex(result)

    def _check_vertex(self, subject: Subject) -> None:
        """Release the chosen vertex if a surface that was opened does not have it."""
        vertex, count = self.state.vertex, len(subject.mesh.vertices)
        if vertex is not None and vertex >= count:
            self.state = replace(self.state, vertex=None)
            self._message = f"there is no vertex {vertex}; there are {count:,}, from 0"

    def _show(self, subject: Subject) -> None:
        """Display a new search result, and keep the previous one in the cache."""
        before = self._viewed.subject
        if before is not None and self.stale:
            self._cached = [*self._cached, before][-MAX_CACHED:]
        self._viewed = replace(self._viewed, subject=subject)

    def _replace(self, subject: Subject) -> None:
        """Replace the displayed surface."""
        if self._viewed.scan is not None:
            self._viewed = replace(self._viewed, scan=subject)
        else:
            self._viewed = replace(self._viewed, subject=subject)

    def _next_job(self) -> SubjectJob | None:
        return next_job(self._viewed, self.state, self.collection.sampling, self._saving)

    def _start_next_job(self) -> None:
        """Start the next job, unless it is already running or has failed."""
        if not self.state.fixed and self._viewed.scan is not None:
            self._viewed = replace(self._viewed, scan=None, fixed=())
        if self.stale and not self.state.fixed:
            sampling = self.collection.sampling
            hits = [item for item in self._cached if not needs_search(item, self.state, sampling)]
            if hits:
                self._cached.remove(hits[0])
                self._show(hits[0])
        job = self._next_job()
        self._worker.request(None if job is None or job.key in self._failed else job)
