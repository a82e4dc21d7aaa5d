"""The command `grasp3d evaluate`: evaluates given grasps on a mesh."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from grasp3d.cli.options import (
    Force,
    InputFile,
    LengthOption,
    ModelOptions,
    OutputFile,
    Overwrite,
    Quiet,
    SurfaceOptions,
    command,
)
from grasp3d.errors import OutputError
from grasp3d.settings import GraspModel, MeshOptions, with_fingers
from grasp3d.system.names import safe_stem


@command
@dataclass(frozen=True)
class Evaluate:
    """Evaluate given grasps: label, critical friction angle and epsilon of each.

    Each contact is moved to the closest point of the surface.
    """

    file: tyro.conf.Positional[InputFile]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    contacts: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CONTACTS")]
    """Contact points in the mesh's frame and unit: CSV or Parquet with columns x1 y1 z1 x2 y2 z2
    ... and one row per grasp, or JSON with a list of grasps, each a list of points [x, y, z]."""

    output: Annotated[OutputFile, tyro.conf.arg(aliases=["-o"])] = None
    """Results (.csv, .parquet or .json) (default: NAME_grasps.csv in this folder)."""

    max_distance: LengthOption = None
    """Largest distance of a contact from the surface (default: 1/100 of the object's size)."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction and sensor resolution; the number of fingers is that of a grasp's contacts."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared. A LENGTH is a number in the mesh's unit, or has a unit."""

    force: Force = False

    overwrite: Overwrite = False

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import grasp_report, report
        from grasp3d.cli.existing_files import check_replaceable
        from grasp3d.grasps.evaluation import evaluate_grasps
        from grasp3d.grasps.reading import read_contacts
        from grasp3d.grasps.writing import SUFFIXES, write_grasps
        from grasp3d.lengths import length_in_unit
        from grasp3d.mesh import prepare_file
        from grasp3d.mesh.plausible_lengths import refuse_lengths
        from grasp3d.system.files import check_suffix

        output = self.output or Path(f"{safe_stem(self.file.stem)}_grasps.csv")
        check_suffix(output, SUFFIXES, "table")
        points = read_contacts(self.contacts)
        if output.exists() and output.samefile(self.contacts):
            raise OutputError(f"{output}: is the file of contacts; name another file with -o")
        model = with_fingers(self.model, points.shape[1])
        check_replaceable(output, overwrite=self.overwrite, source=self.file)
        mesh = prepare_file(self.file, self.mesh)
        source = mesh.report.source
        distance = length_in_unit("max_distance", self.max_distance, mesh.unit, source=source)
        model = model.in_unit(mesh.unit, source=source)
        if not self.force:
            refuse_lengths(mesh, model.lengths() | {"max_distance": distance})
        with report.progress(f"evaluating {self.contacts.name}", quiet=self.quiet) as progress:
            grasps = evaluate_grasps(mesh, points, model, max_distance=distance, progress=progress)
        with report.progress("measuring epsilon", quiet=self.quiet) as progress:
            grasps.compute_epsilon(progress)
        write_grasps(output, grasps)
        if not self.quiet:
            grasp_report.print_evaluated(grasps, output)
        return 0
