"""`grasp3d paper`: the figures and numbers of Wan & Howe 2018, recomputed."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro


@dataclass(frozen=True)
class Paper:
    """Recompute Wan & Howe 2018: its figures 5 to 11, their counterparts in space, its numbers."""

    output: Annotated[Path, tyro.conf.arg(aliases=["-o"])]
    """Folder for figure_05 to figure_11 and surface_..., each as .svg and .png, and numbers.md;
    made if it is missing. Figures 5 and 6 are drawings, always for friction 1 and 30 degrees."""

    friction: float = 1.0
    """Coulomb coefficient of friction; the paper's is 1."""

    sensor_resolution: Annotated[tuple[float, ...], tyro.conf.arg(metavar="DEGREES [DEGREES]")] = (
        30.0,
        15.0,
    )
    """One or two sensor resolutions alpha for the curves and pictures, in degrees."""

    object: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Mesh of a real object to scan as well; none: sphere, box and cylinder only."""

    fixed: Annotated[tuple[float, float, float] | None, tyro.conf.arg(metavar="X Y Z")] = None
    """Place of the fixed finger on the object, in the file's frame; none: where a two-finger grasp
    bears the coarsest sensor."""

    quiet: Annotated[bool, tyro.conf.arg(aliases=["-q"]), tyro.conf.FlagCreatePairsOff] = False
    """Print nothing but errors."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.cli import paper_report, report
        from grasp3d.paper.paper_settings import PaperSettings
        from grasp3d.paper.writing import write_paper

        settings = PaperSettings(
            self.friction, tuple(math.radians(angle) for angle in self.sensor_resolution)
        )
        with report.progress("recomputing the paper", quiet=self.quiet) as progress:
            paper = write_paper(
                self.output,
                settings,
                object_file=self.object,
                fixed=self.fixed,
                progress=progress,
            )
        if not self.quiet:
            paper_report.print_paper(paper, self.output)
        return 0
