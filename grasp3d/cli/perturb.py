"""The command `grasp3d perturb`: labels noisy copies of a scan."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import (
    Force,
    InputFile,
    LengthOption,
    Multifinger,
    NoisyModel,
    OutputFile,
    Overwrite,
    Quiet,
    given_sampling,
)
from grasp3d.settings import GraspModel, MeshOptions, MultifingerSampling, Sampling
from grasp3d.system.names import safe_stem
from grasp3d.validating.perturbing.noise_settings import NoiseSettings

if TYPE_CHECKING:
    from grasp3d.validating.perturbing.perturbation import Perturbation


@dataclass(frozen=True)
class Perturb:
    """Label noisy copies of a scan, and print the errors to enter for it.

    A scan is off by the scanner's noise. This command adds such noise to it again and again, labels
    each copy, and writes for each vertex in how many of them it is S, M and U. It prints a normal
    error and a location error: labelled with these (grasp3d label, batch, evaluate), the scan is S
    only where nearly all of its copies are S.
    """

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Results for each vertex (.ply, .csv or .parquet) (default: NAME_noise.ply in this folder)."""

    figure: OutputFile = None
    """Figure (.svg, .png or .pdf) (default: none)."""

    noise: LengthOption = None
    """Noise of the scanner: standard deviation of its points' errors along the normals, a length
    (default: estimated from the roughness of the surface)."""

    correlation: LengthOption = 0.0
    """Distance over which the errors of neighbours are alike, a length: the radius of a depth
    camera's filter, the edge of a voxel. 0: the errors of neighbours are independent (default:
    0)."""

    copies: int = NoiseSettings.copies
    """Number of noisy copies; 200 for numbers that hardly depend on chance."""

    level: float = NoiseSettings.level
    """What is S with the printed errors must be S in at least this fraction of the copies."""

    noise_seed: int = NoiseSettings.seed
    """Seed of the noise; the same seed gives the same copies."""

    model: NoisyModel = field(default_factory=GraspModel)
    """Friction, sensor resolution and fingers. Errors of contact locations, and those of single
    fingers, are none of the scan's: add them afterwards to the errors that are printed."""

    sampling: Sampling = field(default_factory=Sampling)
    """How candidate grasps are searched. A LENGTH is a number in the mesh's unit, or has a unit:
    80mm, 8cm, 0.08m, 3in."""

    multifinger: Multifinger = field(default_factory=MultifingerSampling)
    """How candidate grasps of three fingers and more are searched."""

    mesh: MeshOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared. A LENGTH is a number in the mesh's unit, or has a unit."""

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def __post_init__(self) -> None:
        self._noise()

    def _noise(self) -> NoiseSettings:
        return NoiseSettings(
            noise=self.noise,
            correlation=self.correlation or 0.0,
            copies=self.copies,
            level=self.level,
            seed=self.noise_seed,
        )

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import perturb_report
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.plots.formats import METADATA
        from grasp3d.plots.rendering import check_rendering
        from grasp3d.system.files import check_suffix
        from grasp3d.validating.perturbing.perturbation import SUFFIXES, write_perturbation

        output = self.output or Path(f"{safe_stem(self.file.stem)}_noise.ply")
        check_suffix(output, SUFFIXES, "table or mesh")
        if self.figure is not None:
            check_suffix(self.figure, METADATA, "figure")
            check_rendering()
        written = [path for path in (output, self.figure) if path is not None]
        for path in written:
            check_replaceable(path, overwrite=self.overwrite, source=self.file)
        found = self._found()
        write_perturbation(output, found)
        if self.figure is not None:
            self._draw(found, self.figure)
        if not self.quiet:
            perturb_report.print_perturbation(found, written)
        return 0

    def _found(self) -> "Perturbation":
        """Read the mesh, and label its copies."""
        from grasp3d.cli import report
        from grasp3d.mesh.noisy_copies import movable_surface
        from grasp3d.mesh.plausible_lengths import refuse_lengths
        from grasp3d.validating.perturbing.perturb import perturb_surface

        sampling = given_sampling(self.sampling, self.multifinger).fitted(self.model.fingers)
        surface = movable_surface(self.file, self.mesh)
        if not self.force:
            refuse_lengths(surface.mesh, self.model, sampling)
        text = f"labelling {self.copies} copies of {self.file.name}"
        with report.progress(text, quiet=self.quiet) as progress:
            return perturb_surface(
                surface,
                self.model,
                noise=self._noise(),
                sampling=sampling,
                progress=progress,
            )

    def _draw(self, found: "Perturbation", path: Path) -> None:
        """Draw the surface, its copies, and the labels with the errors to enter."""
        from grasp3d.plots.formats import save_as
        from grasp3d.plots.perturbations import perturbation_figure

        save_as(perturbation_figure(found), path)
