"""The command `grasp3d paper`: recomputes figures and numbers of Wan & Howe 2018."""

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import Friction, Quiet, SensorResolutions
from grasp3d.cli.report import NOTE, Report, escaped
from grasp3d.settings import DEGREE

if TYPE_CHECKING:
    from grasp3d.paper.writing import Paper as Recomputed


@dataclass(frozen=True)
class Paper:
    """Recompute Wan & Howe 2018: figures 4 to 11, their 3-D counterparts, numbers.

    Without options friction and sensor resolutions are those of the paper.
    """

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"], metavar="FOLDER")]
    """Folder for figure_04 to figure_11, extension_... and surface_..., each as .svg and .png, and
    numbers.md; created if it is missing. Figures 4 to 6 are drawings, always for the same tip,
    friction 1 and 30 degrees. extension_... have uncertain locations, friction and normals."""

    friction: Friction = 1.0

    sensor_resolution: SensorResolutions = (30.0 * DEGREE, 15.0 * DEGREE)
    """One or two sensor resolutions in degrees, each with a column of the figures."""

    object: Annotated[Path | None, tyro.conf.arg(metavar="FILE", help_behavior_hint="")] = None
    """Mesh of a real object to scan as well (default: sphere, box and cylinder only)."""

    fixed: Annotated[
        tuple[float, float, float] | None, tyro.conf.arg(metavar="X Y Z", help_behavior_hint="")
    ] = None
    """Position of the fixed finger on the object, in the mesh's frame and unit (default: a contact
    of the two-finger grasp with the largest maximum sensor resolution)."""

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import progress_bars
        from grasp3d.paper.paper_settings import PaperSettings
        from grasp3d.paper.writing import write_paper

        settings = PaperSettings(self.friction, self.sensor_resolution)
        with progress_bars.progress("recomputing the paper", quiet=self.quiet):
            paper = write_paper(
                self.output,
                settings,
                object_file=self.object,
                fixed=self.fixed,
            )
        if not self.quiet:
            self._print(paper)
        return 0

    def _print(self, paper: "Recomputed") -> None:
        """Print the notes, and the names of the written files, each figure once."""
        report = Report()
        report.lines(paper.notes, NOTE)
        suffixes: dict[str, list[str]] = {}
        for path in paper.written:
            suffixes.setdefault(path.stem, []).append(path.suffix)
        names = ", ".join(f"{stem}{' '.join(ends)}" for stem, ends in suffixes.items())
        report.line(escaped(f"written to {self.output}: {names}"))
