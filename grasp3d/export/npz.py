"""NPZ files: all arrays of labels, compressed."""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.export.fields import present
from grasp3d.export.settings import SETTING, complete_settings
from grasp3d.export.vertex_fields import SURFACE, VERTICES
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.files import atomic_write


def write_npz(path: str | Path, labels: SurfaceLabels) -> None:
    """Write every array as compressed NumPy, with the settings as strings. Raises OutputError.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge=9.0)
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_npz("ball.npz", labels)
        >>> import numpy as np
        >>> stored = np.load("ball.npz")
        >>> stored["partners"].shape, str(stored["setting_unit"])
        ((162, 1, 3), 'cm')
    """
    arrays: dict[str, Any] = {
        **{field.name: values for field, values in present(SURFACE, labels.mesh)},
        **{field.name: values for field, values in present(VERTICES, labels) if field.array},
        **{f"{SETTING}{key}": str(value) for key, value in complete_settings(labels).items()},
    }
    with atomic_write(Path(path)) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays)
