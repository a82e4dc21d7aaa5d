"""The writers of labelled files by suffix."""

from collections.abc import Callable
from pathlib import Path

from grasp3d.errors import OutputError
from grasp3d.export.glb import write_glb
from grasp3d.export.npz import write_npz
from grasp3d.export.parquet import write_fields
from grasp3d.export.ply import write_ply
from grasp3d.export.vtp import write_vtp
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.names import unsupported

WRITERS: dict[str, Callable[[Path, SurfaceLabels], None]] = {
    ".ply": write_ply,
    ".glb": write_glb,
    ".npz": write_npz,
    ".vtp": write_vtp,
    ".parquet": write_fields,
}
"""By suffix."""


def writer_for(path: Path) -> Callable[[Path, SurfaceLabels], None]:
    """Choose the writer by the file's suffix.

    Raises:
        OutputError: No writer has that suffix.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise OutputError(unsupported(path, WRITERS))
    return writer
