"""`grasp3d check`: what is wrong with meshes, before any work."""

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.cli.options import ModelOptions, SamplingOptions, SurfaceOptions
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, MeshOptions, Sampling

if TYPE_CHECKING:
    from grasp3d.batch.checking import CheckedMesh
    from grasp3d.batch.job import BatchSettings
    from grasp3d.batch.plan import MeshFile


@dataclass(frozen=True)
class Check:
    """Diagnose meshes: unit, holes, winding, bodies, crossings, noise, and what repair changes.

    Takes the options of label, and tells whether its labels could be trusted. Exit code 0: of all
    meshes, at least with care; 1: not of all, or some are refused.
    """

    inputs: Annotated[tuple[Path, ...], tyro.conf.Positional, tyro.conf.arg(metavar="FILE|FOLDER")]
    """Mesh files, and folders that are searched with all below them."""

    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """File to write: .json with everything, .csv or .parquet with a row per mesh."""

    json: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Print JSON instead of tables."""

    strict: Annotated[bool, tyro.conf.FlagCreatePairsOff] = False
    """Exit code 1 also where labels can be trusted with care only."""

    workers: int | None = None
    """Processes to use for several meshes; none: one per processor."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction and touch."""

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared."""

    quiet: Annotated[bool, tyro.conf.arg(aliases=["-q"]), tyro.conf.FlagCreatePairsOff] = False
    """Print nothing but errors."""

    def __post_init__(self) -> None:
        if not self.inputs:
            raise SettingError("no input: name a mesh file, or a folder of meshes")
        if self.workers is not None and self.workers < 1:
            raise SettingError(f"workers must be at least 1; got {self.workers}")

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.batch.check_files import SUFFIXES, json_of, write_checks  # noqa: PLC0415
        from grasp3d.batch.job import BatchSettings  # noqa: PLC0415
        from grasp3d.batch.plan import find_meshes  # noqa: PLC0415
        from grasp3d.cli import check_report  # noqa: PLC0415
        from grasp3d.diagnosis.record import Trust  # noqa: PLC0415
        from grasp3d.files import check_suffix, check_writable  # noqa: PLC0415

        files = find_meshes(self.inputs)
        often = Counter(file.name for file in files)
        files = [
            file if often[file.name] == 1 else replace(file, name=str(file.source))
            for file in files
        ]
        if self.output is not None:
            check_suffix(self.output, SUFFIXES, "report")
            for file in files:
                check_writable(self.output, source=file.source)
        settings = BatchSettings(self.model, self.sampling, self.mesh)
        meshes = self._checked(files, settings)
        if self.output is not None:
            write_checks(self.output, meshes, settings)
        if self.json:
            print(json_of(meshes, settings))  # noqa: T201
        elif not self.quiet:
            check_report.print_checks(meshes, one=not any(path.is_dir() for path in self.inputs))
        accepted = {Trust.YES} if self.strict else {Trust.YES, Trust.CARE}
        return 0 if all(mesh.trust in accepted for mesh in meshes) else 1

    def _checked(self, files: list["MeshFile"], settings: "BatchSettings") -> list["CheckedMesh"]:
        """Check one mesh in this process, several in processes of their own."""
        from grasp3d.batch.checking import check_file, lost_check  # noqa: PLC0415
        from grasp3d.cli import report  # noqa: PLC0415
        from grasp3d.processors import available_processors  # noqa: PLC0415

        if len(files) == 1:
            return [check_file(files[0], settings)]
        from grasp3d.batch.run import run  # noqa: PLC0415

        workers, rows = self.workers or available_processors(), []
        with report.counter("checking", len(files), quiet=self.quiet) as advance:
            for row in run(check_file, files, settings, lost=lost_check, workers=workers):
                rows.append(row)
                advance()
        return sorted(rows, key=lambda row: row.name)
