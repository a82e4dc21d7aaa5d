"""The command `grasp3d evaluate`: evaluates given grasps on a mesh."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from grasp3d.cli.options import ModelOptions, Quiet, SurfaceOptions
from grasp3d.errors import OutputError
from grasp3d.settings import GraspModel, MeshOptions, with_fingers
from grasp3d.system.names import safe_stem


@dataclass(frozen=True)
class Evaluate:
    """Evaluate given grasps: label, critical friction angle and epsilon of each.

    Each contact is moved to the closest point of the surface.
    """

    file: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MESH")]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    contacts: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="CONTACTS")]
    """Contact points in the mesh's frame and unit: CSV or Parquet with columns x1 y1 z1 x2 y2 z2
    ... and one row per grasp, or JSON with a list of grasps, each a list of points [x, y, z]."""

    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Results (.csv, .parquet or .json); none: NAME_grasps.csv in this folder."""

    max_distance: float | None = None
    """Largest distance of a contact from the surface, in the mesh's unit; none: 1/100 of the
    object's size."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction and sensor resolution; the number of fingers is that of a grasp's contacts."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared."""

    quiet: Quiet = False

    def run(self) -> int:
        """Run the command, and return the exit code."""
        from grasp3d.cli import grasp_report, report
        from grasp3d.grasps.evaluation import evaluate_grasps
        from grasp3d.grasps.reading import read_contacts
        from grasp3d.grasps.writing import SUFFIXES, write_grasps
        from grasp3d.mesh import prepare_file
        from grasp3d.system.files import check_suffix, check_writable

        output = self.output or Path(f"{safe_stem(self.file.stem)}_grasps.csv")
        check_suffix(output, SUFFIXES, "table")
        points = read_contacts(self.contacts)
        if output.exists() and output.samefile(self.contacts):
            raise OutputError(f"{output}: is the file of contacts; name another file with -o")
        model = with_fingers(self.model, points.shape[1])
        mesh = prepare_file(self.file, self.mesh)
        check_writable(output, source=self.file)
        with report.progress(f"evaluating {self.contacts.name}", quiet=self.quiet) as progress:
            grasps = evaluate_grasps(
                mesh, points, model, max_distance=self.max_distance, progress=progress
            )
        with report.progress("measuring epsilon", quiet=self.quiet) as progress:
            grasps.compute_epsilon(progress)
        write_grasps(output, grasps)
        if not self.quiet:
            grasp_report.print_evaluated(grasps, output)
        return 0
