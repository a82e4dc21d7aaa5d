"""NPZ files: all arrays of labels, compressed."""

import base64
import io
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np

from grasp3d.arrays import ARCHIVE_ERRORS, text_of
from grasp3d.formats.surfaces.stored import FIELDS, Stored
from grasp3d.mesh.reading.sources import Source
from grasp3d.surface.fields import Arrays, Field, present
from grasp3d.surface.label_settings import SETTING
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.system.files import atomic_write
from grasp3d.system.names import reason_of


def write_npz(path: str | Path, labels: SurfaceLabels) -> None:
    """Write every array as compressed NumPy, with the settings as strings. Raises OutputError.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_npz("ball.npz", labels)
        >>> import numpy as np
        >>> stored = np.load("ball.npz")
        >>> stored["partners"].shape, str(stored["setting_unit"])
        ((162, 1, 3), 'cm')
    """
    arrays = _arrays((*SURFACE, *(field for field in VERTICES if field.array)), labels)
    texts = {f"{SETTING}{key}": str(value) for key, value in labels.complete_settings().items()}
    with atomic_write(Path(path)) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays, **texts)


def _arrays(fields: Iterable[Field], labels: SurfaceLabels) -> dict[str, Any]:
    """Fields of labels, and of their mesh, by name."""
    return {
        field.name: values
        for field in fields
        for _, values in present([field], labels.mesh if field in SURFACE else labels)
    }


def packed(fields: Iterable[Field], labels: SurfaceLabels) -> str:
    """Fields of labels, and of their mesh, as an NPZ in base64, for a line of text."""
    stream = io.BytesIO()
    np.savez_compressed(stream, **_arrays(fields, labels))
    return base64.b64encode(stream.getvalue()).decode("ascii")


def unpacked(source: Source, text: str) -> Arrays:
    """The arrays that `packed` has packed, by name. Raises MeshError, ValueError."""
    return _read(source, io.BytesIO(base64.b64decode(text, validate=True))).values


def read_npz(source: Source) -> Stored | None:
    """Read an NPZ of labels; None: it has none of grasp3d. Raises MeshError."""
    with source.path.open("rb") as stream:
        stored = _read(source, stream)
    return stored if stored.settings else None


def _read(source: Source, stream: IO[bytes]) -> Stored:
    """The arrays that are fields, and the settings; nothing is unpickled. Raises MeshError."""
    try:
        with np.load(stream, allow_pickle=False) as archive:
            names = [name for name in archive.files if name in FIELDS]
            values = {name: np.asarray(archive[name]) for name in names}
            settings = {
                name.removeprefix(SETTING): text_of(archive[name])
                for name in archive.files
                if name.startswith(SETTING)
            }
    except ARCHIVE_ERRORS as error:
        reason = reason_of(error)
        raise source.error(f"its arrays cannot be read ({reason}); label the mesh again") from error
    return Stored(source, settings, values)
