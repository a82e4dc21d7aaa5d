"""A viewer without a window: what is chosen, what is shown of it, what is under way."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from grasp3d.errors import SettingError
from grasp3d.settings import MOST_SEARCHED, GraspModel
from grasp3d.system.progress import Progress, ignore
from grasp3d.viewer.session.album import Album
from grasp3d.viewer.session.inspecting import Inspected, inspect
from grasp3d.viewer.session.planning import (
    Saving,
    Viewed,
    Work,
    awaited,
    is_stale,
    reach_of,
    wanted,
)
from grasp3d.viewer.session.recalling import Recall
from grasp3d.viewer.session.saving import check_savable, written
from grasp3d.viewer.session.searching import difference
from grasp3d.viewer.session.state import Shown, choose
from grasp3d.viewer.session.work import Ended, Worker
from grasp3d.viewer.subjects.subject import Subject
from grasp3d.viewer.view_settings import ViewSettings

if TYPE_CHECKING:
    from collections.abc import Hashable

DIFFERENT = 0.005
"""Share of the area on which a new search may disagree with a file before that is told."""


class Session:
    """One person looking at objects.

    A window or page calls `change`, `tap`, `step` and the rest when its user does something, and
    `poll` several times a second; where `revision` has grown, there is something to draw anew.
    All of it in one thread.
    """

    def __init__(self, album: Album, settings: ViewSettings | None = None) -> None:
        settings = settings or ViewSettings()
        self.album = album
        self.settings = settings
        self.shown = Shown(
            model=album.model,
            max_opening=reach_of(album.sampling, album.model),
            paint=settings.paint,
            compare=settings.compare,
        )
        self.revision = 0
        self._said = ""
        self._viewed = Viewed(0, album.exhibits[0])
        self._worker: Worker[Subject] = Worker()
        self._failed: dict[Hashable, str] = {}
        self._saving: Saving | None = None
        self._recall = Recall()
        self._last: tuple[Subject, int, GraspModel, Inspected] | None = None
        self._go_on()

    @property
    def number(self) -> int:
        """Which object of the album is looked at, from 0."""
        return self._viewed.number

    @property
    def name(self) -> str:
        """How it is called."""
        return self._viewed.exhibit.name

    @property
    def subject(self) -> Subject | None:
        """The surface that is shown; None: it is being opened, or cannot be."""
        return self._viewed.current

    @property
    def stale(self) -> bool:
        """Whether the surface belongs to other fingers, limits or fixed fingers than are chosen.

        So it is until theirs are searched, and where they cannot be. Nothing is told of it then.
        """
        return is_stale(self._viewed, self.shown, self.album.sampling)

    @property
    def model(self) -> GraspModel:
        """Friction and resolution that are asked for, and fingers as the surface shown has them."""
        subject = self.subject
        fingers = self.shown.model.fingers if subject is None else subject.model.fingers
        return replace(self.shown.model, fingers=fingers)

    @property
    def other_model(self) -> GraspModel | None:
        """The same at the resolution that is compared with; None: nothing is compared."""
        resolution = self.shown.compare
        return None if resolution is None else replace(self.model, sensor_resolution=resolution)

    @property
    def working(self) -> tuple[str, float] | None:
        """What goes on in the background, and how much of it is done, from 0 to 1."""
        job = self._worker.job
        return None if job is None else (job.words, self._worker.share)

    @property
    def message(self) -> str:
        """What was last said: where a file was written, or why what is chosen is not there."""
        return self._said or self.lacking

    @property
    def lacking(self) -> str:
        """Why what is chosen could not be computed; nothing where it could."""
        job = self._wanted()
        return "" if job is None else self._failed.get(job.key, "")

    @property
    def inspected(self) -> Inspected | None:
        """The vertex that is told of, at what is asked; None: none is, or it must be searched."""
        subject, vertex, model = self.subject, self.shown.vertex, self.model
        if subject is None or vertex is None or vertex >= len(subject.vertices) or self.stale:
            return None
        last = self._last
        if last is None or last[0] is not subject or last[1:3] != (vertex, model):
            self._last = last = (subject, vertex, model, inspect(subject, vertex, model))
        return last[3]

    def change(self, **choices: Any) -> None:  # noqa: ANN401
        """Choose something else.

        Args:
            choices: Fields of `Shown`, and friction, sensor_resolution and fingers of its model.

        Raises:
            SettingError: A value is outside its range; nothing is changed.
        """
        shown = choose(self.shown, choices)
        if "fingers" in choices and not 2 <= shown.model.fingers <= MOST_SEARCHED:
            raise SettingError(
                f"fingers must be from 2 to {MOST_SEARCHED}; got {shown.model.fingers}"
            )
        self._show(shown)

    def tap(self, vertex: int | None, *, inspect: bool = False) -> None:
        """Answer a click on a vertex; None: beside the object.

        While grasps are searched it is remembered: the vertex is told of as soon as they are there.

        Args:
            vertex: Which.
            inspect: Tell of it even where clicks fix fingers.

        Raises:
            SettingError: There is no such vertex.
        """
        subject = self.subject
        if subject is None:
            return
        if vertex is not None and not 0 <= vertex < len(subject.vertices):
            count = len(subject.vertices)
            raise SettingError(f"there is no vertex {vertex}; there are {count:,}, from 0")
        if vertex is None or inspect or self.shown.click == "inspect":
            self._show(replace(self.shown, vertex=vertex))
            return
        x, y, z = (float(value) for value in subject.vertices[vertex])
        kept = self.shown.fixed[: max(0, self.shown.model.fingers - 2)]
        self._show(replace(self.shown, fixed=(*kept, (x, y, z)), vertex=None))

    def step(self, by: int) -> None:
        """Go to another object of the album, after the last to the first."""
        number = (self.number + by) % len(self.album.exhibits)
        if number == self.number:
            return
        self._viewed = Viewed(number, self.album.exhibits[number])
        self._failed.clear()
        self._recall = Recall()
        self._saving, self._said = None, ""
        self.shown = replace(self.shown, vertex=None, fixed=(), section=None)
        self.revision += 1
        self._go_on()

    def save(self, path: Path, progress: Progress = ignore) -> None:
        """Write the labels that are shown, at the friction and resolution that are asked for.

        It waits until the file is there, which takes as long as measuring epsilon does; see
        `save_soon`.

        Args:
            path: File to make or replace.
            progress: Called with the share of the work done, from 0 to 1.

        Raises:
            GraspError: There are none yet, or the file cannot be written.
        """
        ready = written(self._savable(), self.model, path, progress)
        self._replace(ready)
        self.tell(f"saved: {path}")

    def save_soon(self, path: Path) -> None:
        """Do what `save` does in the background; what comes of it is a message.

        Raises:
            GraspError: There are none yet, or no format has that suffix.
        """
        subject = self._savable()
        check_savable(subject, self.model, path)
        self._saving = Saving(path, subject, self.model)
        self._said = ""
        self.revision += 1
        self._go_on()

    def tell(self, message: str) -> None:
        """Say something in the viewer."""
        self._said = message
        self.revision += 1

    def poll(self) -> bool:
        """Take in what was done in the background; tells whether there is something to draw."""
        ended = self._worker.take()
        if ended is None:
            return False
        self._end(ended)
        self.revision += 1
        self._go_on()
        return True

    def close(self) -> None:
        """Give up what is under way."""
        self._worker.want(None)

    def check_shown(self) -> None:
        """Refuse to keep what does not belong to what is chosen.

        Raises:
            SettingError: Nothing is there yet, or grasps are still searched, or cannot be.
        """
        if self.subject is None:
            raise SettingError("there is nothing to save yet; wait until the grasps are searched")
        if not self.stale:
            return
        what = awaited(self.subject, self.shown)
        if self.working is None:
            raise SettingError(f"there are no {what}; choose something else and save then")
        raise SettingError(f"the {what} are still being searched; save when they are there")

    def _savable(self) -> Subject:
        self.check_shown()
        assert self.subject is not None
        return self.subject

    def _show(self, shown: Shown) -> None:
        if shown == self.shown:
            return
        self.shown = shown
        self._said = ""
        self.revision += 1
        self._go_on()

    def _end(self, ended: Ended[Subject]) -> None:
        """Take in how a piece of work ended."""
        what, result = ended.job.key[0], ended.result  # type: ignore[index]
        saving = self._saving if what == "save" else None
        if saving is not None:
            self._saving = None
            self._said = ended.error or f"saved: {saving.path}"
            if result is not None and self.subject is saving.subject:
                self._replace(result)
        elif result is None:
            self._failed[ended.job.key] = ended.error or "it cannot be computed"
        elif what == "scan":
            self._viewed = replace(self._viewed, scan=result, fixed=self.shown.fixed)
        elif what == "grasps":
            self._viewed = replace(self._viewed, subject=self._compared(result))
        elif what == "epsilon":
            self._replace(result)
        else:
            self._put(result)

    def _put(self, subject: Subject) -> None:
        """Show a surface for other fingers or limits, and keep what was there before."""
        before = self._viewed.subject
        if before is not None and self.stale:
            self._recall.keep(before)
        self._viewed = replace(self._viewed, subject=subject)

    def _replace(self, subject: Subject) -> None:
        """Put a subject in the place of what is shown."""
        if self._viewed.scan is not None:
            self._viewed = replace(self._viewed, scan=subject)
        else:
            self._viewed = replace(self._viewed, subject=subject)

    def _compared(self, found: Subject) -> Subject:
        """Tell where grasps that were searched anew are not as good or bad as those of the file."""
        before = self._viewed.subject
        share = 0.0 if before is None else difference(before, found)
        note = (
            f"grasps were searched anew on the file's surface, and {share:.1%} of it has another "
            "label than in the file; label the mesh itself for its own"
        )
        if share > DIFFERENT:
            self._said = note
        return replace(found, notes=(*found.notes, note))

    def _wanted(self) -> Work | None:
        return wanted(self._viewed, self.shown, self.album.sampling, self._saving)

    def _go_on(self) -> None:
        """Begin what is wanted next, or leave what is under way alone if it is just that."""
        if not self.shown.fixed and self._viewed.scan is not None:
            self._viewed = replace(self._viewed, scan=None, fixed=())
        if self.stale and not self.shown.fixed:
            known = self._recall.take(self.shown, self.album.sampling)
            if known is not None:
                self._put(known)
        job = self._wanted()
        self._worker.want(None if job is None or job.key in self._failed else job)
