"""`grasp3d label`: one mesh in, one labelled mesh out."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

import tyro

from grasp3d.cli.options import ModelOptions, SamplingOptions, SurfaceOptions
from grasp3d.settings import GraspModel, MeshOptions, Sampling


@dataclass(frozen=True)
class Label:
    """Label one mesh: print how much of it is reliably graspable, and write it with colours."""

    file: tyro.conf.Positional[Path]
    """Mesh file: STL, OBJ, PLY, OFF, GLB, 3MF, ..."""

    output: Annotated[Path | None, tyro.conf.arg(aliases=["-o"])] = None
    """Labelled file (.ply, .glb, .npz or .vtp); none: NAME_labeled.ply in this folder."""

    model: ModelOptions = field(default_factory=GraspModel)
    """Friction and touch."""

    sampling: SamplingOptions = field(default_factory=Sampling)
    """How candidate grasps are searched."""

    mesh: SurfaceOptions = field(default_factory=MeshOptions)
    """How the mesh is read and prepared."""

    quiet: Annotated[bool, tyro.conf.arg(aliases=["-q"]), tyro.conf.FlagCreatePairsOff] = False
    """Print nothing but errors."""

    def run(self) -> int:
        """Do it; returns the exit code."""
        from grasp3d.cli import report  # noqa: PLC0415
        from grasp3d.export import writer_for  # noqa: PLC0415
        from grasp3d.files import check_writable  # noqa: PLC0415
        from grasp3d.mesh import load_mesh  # noqa: PLC0415
        from grasp3d.surface import label_surface  # noqa: PLC0415

        output = self.output or Path(f"{self.file.stem}_labeled.ply")
        write = writer_for(output)
        mesh = load_mesh(
            self.file,
            unit=self.mesh.unit,
            max_edge=self.mesh.max_edge,
            crease_angle=self.mesh.crease_angle,
        )
        check_writable(output, source=self.file)
        with report.progress(f"labelling {self.file.name}", quiet=self.quiet) as progress:
            labels = label_surface(mesh, self.model, sampling=self.sampling, progress=progress)
        with report.progress("measuring epsilon", quiet=self.quiet) as progress:
            labels.measure(progress)
        write(output, labels)
        if not self.quiet:
            report.print_labels(labels, output)
        return 0
