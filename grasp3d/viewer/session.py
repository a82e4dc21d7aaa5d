"""State of a viewer, without its display: choices, displayed surface, background job.

One job runs at a time; a new request replaces it.
"""

import threading
from collections.abc import Callable, Hashable, Iterator
from contextvars import copy_context
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import Any, Generic, TypeAlias, TypeVar

import numpy as np

from grasp3d.errors import GraspError, SettingError
from grasp3d.grasps.best import best_grasps, first_vertices
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.scene import Scene
from grasp3d.pictures.colors import LOAD, QUANTITIES
from grasp3d.pictures.subject import NO_LABELS, Subject
from grasp3d.pictures.view_settings import Paint, ViewSettings
from grasp3d.settings import MAX_SEARCHED_FINGERS, GraspModel
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.context import running
from grasp3d.system.names import describe_unexpected, noun
from grasp3d.viewer.collection import (
    Collection,
    ViewState,
    changed_state,
    check_savable,
    scan_with_fixed,
    search_grasps,
    search_wider,
    write_labels,
)
from grasp3d.viewer.inspection import Inspection, inspect, inspect_given, inspect_pose

ResultT = TypeVar("ResultT")


class Cancelled(BaseException):
    """Raised in a job by its progress report if the job is no longer needed."""


@dataclass(frozen=True, eq=False)
class Job(Generic[ResultT]):
    """A computation."""

    key: Hashable
    """Key of the job; a request with the key of the running job does not restart it."""
    text: str
    """Description, such as 'searching grasps'."""
    run: Callable[[], ResultT]
    delay: float = 0.0
    """Waiting time before it starts, in which a newer request can replace it [s]."""
    then: Callable[[ResultT], None] | None = None
    """Called by the owner with the result; None: the result stays where it was computed."""


@dataclass(eq=False)
class Run(Generic[ResultT]):
    """A job that is running, or has finished with a result or an error."""

    job: Job[ResultT]
    fraction: float = 0.0
    """Finished fraction, from 0 to 1."""
    result: ResultT | None = None
    error: str | None = None
    """Why there is no result, as one sentence."""
    stop: threading.Event = field(default_factory=threading.Event)

    def report(self, fraction: float) -> None:
        """Store the finished fraction; end the job if it is no longer needed."""
        if self.stop.is_set():
            raise Cancelled
        self.fraction = fraction


class Worker(Generic[ResultT]):
    """Worker that runs the job requested last, in a thread.

    A replaced job ends at its next progress report. Only the job itself runs in the thread; all
    methods are called from the owner's thread.
    """

    def __init__(self) -> None:
        self._finished: SimpleQueue[Run[ResultT]] = SimpleQueue()
        self._run: Run[ResultT] | None = None

    @property
    def job(self) -> Job[ResultT] | None:
        """The running job."""
        return None if self._run is None else self._run.job

    @property
    def fraction(self) -> float:
        """Finished fraction of the running job, from 0 to 1."""
        return 0.0 if self._run is None else self._run.fraction

    def request(self, job: Job[ResultT] | None) -> None:
        """Run a job instead of the current one; None: cancel the current one."""
        if self._run is not None and job is not None and self._run.job.key == job.key:
            return
        if self._run is not None:
            self._run.stop.set()
        self._run = None
        if job is not None:
            self._run = Run(job)
            # A new thread would not inherit the number of threads set in this context.
            execute = partial(copy_context().run, self._execute, self._run)
            threading.Thread(target=execute, daemon=True).start()

    def take_finished(self) -> Run[ResultT] | None:
        """Return the current job once it has finished; each job is returned only once."""
        while True:
            try:
                run = self._finished.get_nowait()
            except Empty:
                return None
            if run is self._run:
                self._run = None
                return run

    def _execute(self, run: Run[ResultT]) -> None:
        job = run.job
        if run.stop.wait(job.delay):
            return
        try:
            with running(progress=run.report):
                run.result = job.run()
        except Cancelled:
            return
        except GraspError as error:
            run.error = str(error)
        except MemoryError:
            run.error = f"{job.text}: memory is too small; use a coarser mesh"
        except Exception as error:  # noqa: BLE001
            run.error = describe_unexpected(error)
        self._finished.put(run)


OF_FINGERS = frozenset({"fingers", "fixed"})
"""Choices that do not apply to given poses of a hand."""

BEST = 20
"""Number of best grasps through which a user can step."""

MAX_CACHED = 3
"""Number of search results kept for an object; a large one takes hundreds of megabytes."""

DELAY = 0.4
"""Delay between the last change of a slider and the computation for it [s]."""

Best: TypeAlias = GraspTable | EvaluatedPoses


class Session:
    """State of one user's view of a collection.

    A window or page calls `change`, `click`, `step` and so on for the user's actions, and `poll`
    several times a second. It redraws when `revision` has grown. All calls must come from one
    thread.
    """

    def __init__(self, collection: Collection, settings: ViewSettings | None = None) -> None:
        """Open the first object.

        Args:
            collection: The objects.
            settings: Initial view; None: the default.
        """
        settings = settings or ViewSettings()
        self.collection = collection
        self.settings = settings
        self.state = ViewState(collection.model, settings.paint, vertex=settings.vertex)
        self.revision = 0
        self.steps = 0
        """Number of steps to other grasps so far; the camera turns at each step."""
        self._message = ""
        self._worker: Worker[Any] = Worker()
        self._open(0)

    def _open(self, number: int) -> None:
        """Open an object, and discard all data of the previous one."""
        self.number = number
        """Index of the current object in the collection, from 0."""
        self._opened: Subject | None = None
        self._results: dict[Hashable, Subject] = {}
        """Results of searches by the choices they depend on, the latest last."""
        self._displayed: Subject | None = None
        self._subject: Subject | None = None
        self._best: dict[Hashable, Best] = {}
        self._failed: dict[Hashable, str] = {}
        self._saving: tuple[Path, Subject] | None = None
        self._inspected: tuple[tuple[object, ...], Inspection] | None = None
        self._start_next_job()

    @property
    def name(self) -> str:
        """Name of the current object."""
        return self.collection.items[self.number].name

    @property
    def subject(self) -> Subject | None:
        """The displayed surface at the chosen friction and resolution.

        None: the object is being opened, or cannot be opened.
        """
        found = self._displayed
        if found is None or found.poses is not None:
            return found
        model = self.model
        before = self._subject
        if (
            before is None
            or before.model != model
            or before.labels.contacts is not found.labels.contacts
        ):
            self._subject = found.at(model)
        return self._subject

    @property
    def stale(self) -> bool:
        """Whether the surface is for other fingers or fixed fingers than are chosen.

        Until the right grasps have been searched, no results are displayed. A surface whose search
        did not go far enough is not stale: its unknown part is grey.
        """
        opened = self._opened
        return opened is not None and opened.poses is None and self._wanted not in self._results

    @property
    def model(self) -> GraspModel:
        """Chosen friction and resolution, with the displayed surface's number of fingers."""
        shown, model = self._displayed, self.state.model
        # A copy checks all settings again, which takes longer than the labels of a small surface.
        if shown is None or shown.model.fingers == model.fingers:
            return model
        return replace(model, fingers=shown.model.fingers)

    @property
    def working(self) -> tuple[str, float] | None:
        """Description and finished fraction (0 to 1) of the background job; None: idle."""
        job = self._worker.job
        return None if job is None else (job.text, self._worker.fraction)

    @property
    def saving(self) -> bool:
        """Whether a file is being written, or waits to be written."""
        return self._saving is not None

    @property
    def message(self) -> str:
        """The last message, or the reason why the current choices failed."""
        return self._message or self.failure

    @property
    def failure(self) -> str:
        """Reason why the current choices could not be computed; empty if they could."""
        return next(
            (self._failed[job.key] for job in self._needed() if job.key in self._failed), ""
        )

    @property
    def inspection(self) -> Inspection | None:
        """The inspected vertex, the best grasp reached by stepping, or the given grasp.

        None: none of them is chosen, or the grasp is not known yet.
        """
        subject, vertex = self.subject, self.state.vertex
        if subject is None or self.stale:
            return None
        shown, model, best = subject.poses, self.model, self._best_one()
        if isinstance(best, GraspTable):
            vertex = int(first_vertices(best)[0])
        elif best is not None:
            shown = best
        if vertex is None and shown is None:
            return inspect_given(subject, model)
        key = (subject, vertex, self.state.grasp, model)
        if self._inspected is None or self._inspected[0] != key:
            if shown is not None:
                found = inspect_pose(shown, model)
            else:
                assert vertex is not None
                found = inspect(subject, vertex)
            self._inspected = key, found
        return self._inspected[1]

    def _best_one(self) -> Best | None:
        """The best grasp reached by stepping, one row; None if there is none or it is unknown."""
        best, row = self._best.get(self._wanted), self.state.grasp
        if best is None or row is None or not best.size:
            return None
        return best.take(np.array([row % best.size]))

    @property
    def scene(self) -> Scene | None:
        """The gripper and the table of the current object; None: there is no gripper."""
        return None if self._opened is None else self._opened.labels.scene

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
        """Handle a click on a vertex, or beside the object (None).

        A click during a search is stored; the vertex is inspected when the search has finished.

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
            by: Number of grasps to go forward; negative: back.

        Raises:
            SettingError: The surface is not known yet.
        """
        opened, row = self._opened, self.state.grasp
        if opened is not None and opened.poses is not None:
            self.step(by)
            return
        if opened is None or self.stale:
            raise SettingError("the grasps are not known yet; wait until they are searched")
        row = ((-1 if by > 0 else 0) if row is None else row) + by
        self._set_state(replace(self.state, vertex=None, grasp=row))
        self._say_best()

    def _say_best(self) -> None:
        """Show the number of the displayed best grasp, as soon as the best grasps are known."""
        best, row = self._best.get(self._wanted), self.state.grasp
        if best is None or row is None:
            return
        if best.size:
            self.steps += 1
            self.show_message(f"{row % best.size + 1} of the {best.size} best grasps")
        else:
            self.state = replace(self.state, grasp=None)
            self.show_message("there is no grasp on this surface")

    def check_gripper(self, *, table: bool = False) -> None:
        """Check that the current object has a gripper.

        Args:
            table: Whether it must also stand on a table.

        Raises:
            SettingError: There is no gripper, or no table.
        """
        if self._opened is None:
            return
        scene = self.scene
        if scene is None:
            raise SettingError("there is no gripper; open the object with one (--hand)")
        if table and scene.table is None:
            raise SettingError("there is no table; open the object with one (--table)")

    def check_paint(self, paint: Paint) -> None:
        """Check that the current object has the data that colours show.

        Raises:
            SettingError: The object has no gripper, or no load.
        """
        subject = self.subject
        if subject is not None and paint != "label" and subject.poses is None:
            problem = QUANTITIES[paint].problem_of(subject)
            if problem:
                raise SettingError(problem)

    def offers(self, paint: Paint) -> bool:
        """Whether the current object has the data that colours show."""
        if self.subject is None:
            return paint == "label" or QUANTITIES[paint].problem is None
        try:
            self.check_paint(paint)
        except SettingError:
            return False
        return True

    def step(self, by: int) -> None:
        """Go forward or back by a number of objects in the collection, cyclically.

        Raises:
            SettingError: A file is being saved.
        """
        number = (self.number + by) % len(self.collection.items)
        if number == self.number:
            return
        if self._saving is not None:
            raise SettingError(f"{self._saving[0].name} is being saved; wait until that is done")
        self.state = replace(self.state, vertex=None, grasp=None, fixed=(), section=None)
        self._message = ""
        self.revision += 1
        self._open(number)

    def save(self, path: Path) -> None:
        """Write the displayed labels at the chosen friction and resolution, in the background.

        Saving takes as long as computing epsilon; a message reports the result.

        Args:
            path: File to create or replace.

        Raises:
            GraspError: There are no labels yet, or no format has this suffix.
        """
        self.check_current()
        subject = self.subject
        assert subject is not None
        check_savable(subject, path)
        self._saving = path, subject
        self._go_on()

    def show_message(self, message: str) -> None:
        """Display a message."""
        self._message = message
        self.revision += 1

    def poll(self) -> bool:
        """Process a finished background job; return whether there was one."""
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
            SettingError: There is no surface yet, or its grasps are being searched, or cannot be.
        """
        if self.subject is None:
            raise SettingError("there is nothing to save yet; wait until the grasps are searched")
        if not self.stale:
            return
        count = len(self.state.fixed)
        missing = f"grasps for {self.state.model.fingers} fingers"
        if count:
            missing = f"labels for {count} fixed {noun(count, 'fingers')}"
        if self.working is None:
            raise SettingError(f"there are no {missing}; change the settings before saving")
        raise SettingError(
            f"the {missing} are still being searched; save when the search is finished"
        )

    def _set_state(self, state: ViewState) -> None:
        if state == self.state:
            return
        if (state.model, state.fixed) != (self.state.model, self.state.fixed):
            self._failed.clear()
        self.state = state
        self._go_on()

    def _go_on(self) -> None:
        """Clear the last message, and start the jobs that the choices need."""
        self._message = ""
        self.revision += 1
        self._start_next_job()

    @property
    def _wanted(self) -> Hashable:
        """Key of the surface that belongs to the current choices."""
        fixed = self.state.fixed
        return ("scan", fixed) if fixed else ("grasps", self.state.model.fingers)

    def _needed(self) -> Iterator[Job[Any]]:
        """Yield the jobs that the choices need, in order; later ones do not need failed ones."""
        opened, saving, wanted = self._opened, self._saving, self._wanted
        if opened is None:
            item = self.collection.items[self.number]
            yield Job(("open", self.number), f"opening {item.name}", item.open, then=self._take)
            return
        if saving is not None:
            path, subject = saving
            run = partial(write_labels, subject, path)
            yield Job(("save", path, subject.model), f"saving {path.name}", run)
        if opened.poses is not None:
            return
        jobs = (self._search_job(opened), self._best_job(), self._column_job())
        yield from filter(None, jobs if wanted in self._results else jobs[:1])

    def _search_job(self, opened: Subject) -> Job[Any] | None:
        """Return the search, or the scan with fixed fingers, that the choices need."""
        model, fixed, sampling = self.state.model, self.state.fixed, self.collection.sampling
        wanted, text = self._wanted, "searching grasps"
        found, then = self._results.get(wanted), partial(self._keep, wanted)
        if found is not None and not found.covers(model):
            run = partial(search_wider, found, model, sampling)
            return Job(("wider", wanted), text, run, DELAY, then)
        if found is not None:
            return None
        if fixed:
            return Job(
                wanted, "scanning", partial(scan_with_fixed, opened, model, fixed), 0.0, then
            )
        return Job(wanted, text, partial(search_grasps, opened, model, sampling), DELAY, then)

    def _best_job(self) -> Job[Any] | None:
        """Return the search for the best grasps, if the user steps through them."""
        wanted = self._wanted
        if self.state.grasp is None or wanted in self._best or wanted not in self._results:
            return None

        def keep(best: Best) -> None:
            self._best[wanted] = best
            self._say_best()

        run = partial(best_grasps, self._results[wanted].labels, BEST)
        return Job(("best", wanted), "choosing the best grasps", run, then=keep)

    def _column_job(self) -> Job[Any] | None:
        """Return the job for the data that colours show, if it takes long; labels keep them."""
        subject, paint = self.subject, self.state.paint
        if subject is None or paint == "label":
            return None
        shown = QUANTITIES[paint]
        if shown.problem_of(subject) or not shown.missing(subject.labels):
            return None
        text = "computing grip forces" if shown.needs == LOAD else "computing ε"
        run = partial(getattr, subject.labels, shown.needs)
        return Job((shown.needs, self._wanted, self.model), text, run, DELAY)

    def _process(self, finished: Run[Any]) -> None:
        """Store the result or the error of a finished job."""
        job = finished.job
        if self._saving is not None:
            self._message = finished.error or f"saved: {self._saving[0]}"
            self._saving = None
        elif finished.error is not None:
            self._failed[job.key] = finished.error
        elif job.then is not None:
            job.then(finished.result)

    def _take(self, opened: Subject) -> None:
        """Show an object that has been opened."""
        self._opened = self._displayed = opened
        self._keep(("grasps", opened.model.fingers), opened)
        self._check_vertex(opened)

    def _keep(self, key: Hashable, result: Subject) -> None:
        """Keep a search result, and discard the one that was shown longest ago."""
        if self._results.get(key) is not result:
            self._best.pop(key, None)
        self._results.pop(key, None)
        self._results[key] = result
        for oldest in list(self._results)[:-MAX_CACHED]:
            if self._results[oldest] is not self._opened:
                del self._results[oldest]
                self._best.pop(oldest, None)

    def _check_vertex(self, subject: Subject) -> None:
        """Deselect the chosen vertex if an opened surface does not have it."""
        vertex, count = self.state.vertex, len(subject.mesh.vertices)
        if vertex is not None and vertex >= count:
            self.state = replace(self.state, vertex=None)
            self._message = f"there is no vertex {vertex}; there are {count:,}, from 0"

    def _start_next_job(self) -> None:
        """Display the known result, and start the next job unless it is running or has failed."""
        found = self._results.get(self._wanted)
        if found is not None:
            self._keep(self._wanted, found)
            self._displayed = found
        self._worker.request(
            next((job for job in self._needed() if job.key not in self._failed), None)
        )
