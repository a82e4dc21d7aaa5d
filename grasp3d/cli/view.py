"""`grasp3d view`: view an object in a window, in a browser, or as a picture."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import (
    Flag,
    Force,
    LoadGroup,
    Multifinger,
    OutputFile,
    Overwrite,
    Quiet,
    ReachGroup,
    given_sampling,
)
from grasp3d.cli.time_limit import (
    DEFAULT_TIMEOUT,
    Timeout,
    check_timeout,
    time_limit,
)
from grasp3d.errors import GraspError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, MeshOptions, MultifingerSampling, Sampling
from grasp3d.system.names import printable
from grasp3d.viewer.view_settings import ViewSettings

if TYPE_CHECKING:
    from grasp3d.viewer.session.collection import Collection


@dataclass(frozen=True)
class View:
    """View an object: rotate it, change friction and resolution, click for reasons."""

    target: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="PATH")]
    """A mesh, a labelled PLY, or the folder of results of `grasp3d batch`."""

    web: Flag = False
    """Serve a page for a browser instead of opening a window, as where there is no display; each
    visitor has a view of their own."""

    host: Annotated[str, tyro.conf.arg(metavar="ADDRESS")] = "127.0.0.1"
    """Address of the page; at 127.0.0.1 only this computer can connect."""

    port: Annotated[int, tyro.conf.arg(metavar="PORT")] = 8080
    """Port of the page; if it is in use, the next free one."""

    screenshot: OutputFile = None
    """Write a picture (.png) instead; needs no display."""

    turntable: OutputFile = None
    """Write a film of one full turn (.gif or .mp4) instead; needs no display."""

    view: ViewSettings = field(default_factory=ViewSettings)
    """Initial view of the object."""

    model: GraspModel = field(default_factory=GraspModel)
    """Grasp model; options with their default are taken from a labelled file."""

    sampling: Sampling = field(default_factory=Sampling)
    """How candidate grasps are searched; likewise from a labelled file."""

    multifinger: Multifinger = field(default_factory=MultifingerSampling)

    reach: ReachGroup = field(default_factory=ReachSettings)

    load: LoadGroup = field(default_factory=Load)

    mesh: MeshOptions = field(default_factory=MeshOptions)
    """How a mesh is read and prepared; likewise from a labelled file."""

    timeout: Timeout = DEFAULT_TIMEOUT

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def __post_init__(self) -> None:
        check_timeout(self.timeout)

    def run(self) -> int:
        """Run the command; returns the exit code."""
        with time_limit(self.timeout, printable(str(self.target))):
            collection, problem = self._opened()
        self._write(collection)
        if self.web or problem:
            self._serve(collection, problem)
        elif not (self.screenshot or self.turntable):
            from grasp3d.viewer.session.session import Session
            from grasp3d.viewer.window.desktop import show_window

            show_window(Session(collection, self.view))
        return 0

    def _opened(self) -> tuple["Collection", str]:
        """The collection, with its first object opened, and why no window can be opened."""
        from grasp3d.cli import progress_bars
        from grasp3d.viewer.session.collection import open_collection

        collection = open_collection(
            self.target,
            self.model,
            given_sampling(self.sampling, self.multifinger),
            self.mesh,
            force=self.force,
            reach=self.reach,
            load=self.load.chosen,
        )
        problem = self._check()
        first = collection.items[0]
        try:
            with progress_bars.progress(f"opening {first.name}", quiet=self.quiet):
                first.open()
        except GraspError:
            if len(collection.items) == 1:
                raise  # with several objects the viewer shows the error of the first one
        return collection, problem

    def _check(self) -> str:
        """Check that the output is possible, before the work begins.

        Returns:
            Why no window can be opened; empty if one can, or is not needed.
        """
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.viewer.scene.pictures import check_film, check_picture
        from grasp3d.viewer.window.display import display_problem

        if self.screenshot:
            check_picture(self.screenshot)
            check_replaceable(self.screenshot, overwrite=self.overwrite)
        if self.turntable:
            check_film(self.turntable)
            check_replaceable(self.turntable, overwrite=self.overwrite)
        needs_window = not (self.web or self.screenshot or self.turntable)
        problem = display_problem() if needs_window else ""
        if self.web or problem:
            from grasp3d.viewer.web.page import check_page

            check_page(self.host, self.port)
        return problem

    def _write(self, collection: "Collection") -> None:
        """Write the requested pictures and films."""
        from grasp3d.cli import progress_bars
        from grasp3d.viewer.scene.pictures import save_picture, save_turntable

        for path, save in ((self.screenshot, save_picture), (self.turntable, save_turntable)):
            if path is None:
                continue
            with progress_bars.progress(f"rendering {path.name}", quiet=self.quiet):
                save(collection, self.view, path)
            self._print(f"written: {path}")

    def _serve(self, collection: "Collection", problem: str) -> None:
        """Serve the page; say first why no window was opened, if that is the reason."""
        from grasp3d.viewer.web.page import serve, uses_other_port

        def ready(address: str) -> None:
            note = f"{problem}; " if problem else ""
            note += f"{self.port} is in use; " if uses_other_port(address, self.port) else ""
            self._print(f"{note}{address} shows {self.target.name}; Ctrl+C stops it")

        serve(collection, self.view, host=self.host, port=self.port, ready=ready)

    def _print(self, line: str) -> None:
        if not self.quiet:
            print(printable(line), flush=True)  # noqa: T201
