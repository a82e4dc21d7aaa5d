"""GLB files of surfaces in the colours of the labels."""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import label_colors
from grasp3d.system.files import atomic_write


def write_glb(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a GLB coloured by label, for any 3-D viewer. Raises OutputError.

    The settings are in the extras of its asset, as text under `grasp3d`.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_glb("ball.glb", labels)
        >>> trimesh.load_scene("ball.glb").to_mesh().visual.vertex_colors.shape
        (162, 4)
    """
    import trimesh

    srgb = label_colors(labels) / 255.0
    # glTF's vertex colours are linear, the colours of the legend are sRGB.
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    mesh = trimesh.Trimesh(
        labels.mesh.vertices,
        labels.mesh.faces,
        vertex_normals=-labels.mesh.normals,
        vertex_colors=np.round(255.0 * linear).astype(np.uint8),
        process=False,
    )
    settings = {key: str(value) for key, value in labels.settings().items()}

    def add_settings(tree: dict[str, Any]) -> None:
        tree["asset"]["extras"] = {"grasp3d": settings}

    content = trimesh.exchange.gltf.export_glb(
        mesh.scene(), include_normals=True, tree_postprocessor=add_settings
    )
    with atomic_write(Path(path)) as part:
        part.write_bytes(content)
