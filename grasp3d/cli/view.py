"""`grasp3d view`: look at an object, in a window, in a browser, or as a picture."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import ModelOptions, SamplingOptions, SurfaceOptions, ViewOptions
from grasp3d.errors import GraspError
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.system.names import printable
from grasp3d.viewer.view_settings import ViewSettings

if TYPE_CHECKING:
    from grasp3d.viewer.session.album import Album


@dataclass(frozen=True)
class View:
    """Look at an object: turn it, move friction and sensor resolution, click to see why."""

    target: tyro.conf.Positional[Path]
    """A mesh, a PLY that was labelled, or the folder that `grasp3d batch` wrote."""

    web: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Serve a page for a browser in place of a window; each visitor has a view of their own."""

    host: str = "127.0.0.1"
    """Address that the page is served at; this computer alone can reach the usual one."""

    port: int = 8080
    """Its port; where it is in use, the next free one."""

    screenshot: Path | None = None
    """Write a picture (.png) instead; needs no display."""

    turntable: Path | None = None
    """Write a film of a whole turn (.gif or .mp4) instead; needs no display."""

    view: ViewOptions = field(default_factory=ViewSettings)
    """How the object is first shown."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction and touch; what has its usual value is as in a labelled file."""

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched; likewise."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How a mesh is read and prepared; likewise."""

    quiet: Annotated[bool, tyro.conf.arg(aliases=["-q"]), tyro.conf.FlagCreatePairsOff] = False
    """Print nothing but errors."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.cli import report
        from grasp3d.viewer.session.album import open_album

        album = open_album(self.target, self.model, self.sampling, self.mesh)
        self._check()
        if not self.quiet:
            report.report_compiling()
        first = album.exhibits[0]
        try:
            with report.progress(f"opening {first.name}", quiet=self.quiet) as progress:
                first.open(progress)
        except GraspError:
            if len(album.exhibits) == 1:
                raise  # of several the viewer tells it, and goes on to the next
        self._write(album)
        if self.web:
            self._serve(album)
        elif not (self.screenshot or self.turntable):
            from grasp3d.viewer.session.session import Session
            from grasp3d.viewer.window.desktop import show_window

            show_window(Session(album, self.view))
        return 0

    def _check(self) -> None:
        """Tell before the work what would not be possible after it."""
        from grasp3d.viewer.scene.pictures import check_film, check_picture
        from grasp3d.viewer.window.display import check_display

        if self.screenshot:
            check_picture(self.screenshot)
        if self.turntable:
            check_film(self.turntable)
        if self.web:
            from grasp3d.viewer.web.page import check_page

            check_page(self.host, self.port)
        elif not (self.screenshot or self.turntable):
            check_display()

    def _write(self, album: "Album") -> None:
        """Write the pictures that are asked for."""
        from grasp3d.cli import report
        from grasp3d.viewer.scene.pictures import save_picture, save_turntable

        for path, save in ((self.screenshot, save_picture), (self.turntable, save_turntable)):
            if path is None:
                continue
            with report.progress(f"drawing {path.name}", quiet=self.quiet) as progress:
                save(album, self.view, path, progress=progress)
            self._say(f"written: {path}")

    def _serve(self, album: "Album") -> None:
        from grasp3d.viewer.web.page import serve, taken

        def ready(address: str) -> None:
            note = f"{self.port} is in use; " if taken(address, self.port) else ""
            self._say(f"{note}{address} shows {self.target.name}; Ctrl-C ends it")

        serve(album, self.view, host=self.host, port=self.port, ready=ready)

    def _say(self, line: str) -> None:
        if not self.quiet:
            print(printable(line), flush=True)  # noqa: T201
