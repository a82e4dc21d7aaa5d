"""The command `grasp3d check`: diagnoses meshes before they are labelled."""

from dataclasses import dataclass, field
from functools import partial
from typing import TYPE_CHECKING, Annotated

import tyro

from grasp3d.batch.batch_settings import ClusterSettings
from grasp3d.cli.options import (
    Flag,
    Force,
    Inputs,
    Multifinger,
    OutputFile,
    Overwrite,
    Quiet,
    given_sampling,
)
from grasp3d.errors import SettingError
from grasp3d.settings import GraspModel, MeshOptions, MultifingerSampling, Sampling

if TYPE_CHECKING:
    from grasp3d.batch.batch_settings import BatchSettings
    from grasp3d.batch.checking import CheckedMesh
    from grasp3d.batch.inputs import MeshFile


@dataclass(frozen=True)
class Check:
    """Diagnose meshes: unit, holes, orientation, bodies, self-intersections, noise.

    With the options of label it reports whether labels can be trusted. Exit code 0: for all
    meshes, at least with care; 1: not for all meshes, or some cannot be read.
    """

    inputs: Inputs

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Report: .json with all results, .csv or .parquet with one row per mesh."""

    json: Flag = False
    """Print JSON instead of tables."""

    strict: Flag = False
    """Exit code 1 also for meshes whose labels can be trusted with care only."""

    model: GraspModel = field(default_factory=GraspModel)
    """Friction, sensor resolution and fingers."""

    sampling: Sampling = field(default_factory=Sampling)
    """How candidate grasps are searched. A LENGTH is a number in the mesh's unit, or has a unit:
    80mm, 8cm, 0.08m, 3in."""

    multifinger: Multifinger = field(default_factory=MultifingerSampling)
    """How candidate grasps of three fingers and more are searched."""

    mesh: MeshOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared. A LENGTH is a number in the mesh's unit, or has a unit."""

    cluster: ClusterSettings = field(default_factory=ClusterSettings)
    """Which processes check the meshes, if there are several."""

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def __post_init__(self) -> None:
        if not self.inputs:
            raise SettingError("no input: name a mesh file, or a folder of meshes")

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.batch.batch_settings import BatchSettings
        from grasp3d.batch.checking import SUFFIXES, json_of, write_checks
        from grasp3d.batch.inputs import find_meshes
        from grasp3d.batch.storage import local_path
        from grasp3d.cli import check_report
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.mesh.diagnosis import Trust
        from grasp3d.system.files import check_suffix, check_writable

        files = find_meshes(self.inputs)
        if self.output is not None:
            check_suffix(self.output, SUFFIXES, "report")
            for file in files:
                check_writable(self.output, source=local_path(file.source))
            check_replaceable(self.output, overwrite=self.overwrite)
        settings = BatchSettings(
            self.model, given_sampling(self.sampling, self.multifinger), self.mesh
        )
        meshes = self._checked(files, settings)
        if self.output is not None:
            write_checks(self.output, meshes, settings)
        if self.json:
            print(json_of(meshes, settings))  # noqa: T201
        elif not self.quiet:
            given = {str(local_path(item) or item) for item in self.inputs}
            check_report.print_checks(meshes, named=all(file.source in given for file in files))
        accepted = {Trust.YES} if self.strict else {Trust.YES, Trust.CARE}
        return 0 if all(mesh.trust in accepted for mesh in meshes) else 1

    def _checked(self, files: list["MeshFile"], settings: "BatchSettings") -> list["CheckedMesh"]:
        """Check one mesh in this process, several in child processes."""
        from grasp3d.batch.checking import check_file, lost_check
        from grasp3d.cli import report

        if len(files) == 1:
            return [check_file(files[0], settings, force=self.force)]
        from grasp3d.batch.run import run

        rows = []
        with report.counter("checking", len(files), quiet=self.quiet) as advance:
            check = partial(check_file, force=self.force)
            checks = run(check, files, settings, lost=lost_check, cluster=self.cluster, kernels=0)
            for row in checks:
                rows.append(row)
                advance()
        return sorted(rows, key=lambda row: row.name)
