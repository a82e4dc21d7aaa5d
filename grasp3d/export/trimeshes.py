"""Meshes and labels as objects of trimesh."""

from typing import TYPE_CHECKING

from grasp3d.export.settings import settings_of
from grasp3d.export.vtp import point_arrays
from grasp3d.mesh import ObjectMesh
from grasp3d.surface.labels import SurfaceLabels

if TYPE_CHECKING:
    import trimesh


def mesh_to_trimesh(mesh: ObjectMesh) -> "trimesh.Trimesh":
    """The surface as a trimesh, with outward normals and its unit."""
    import trimesh

    made = trimesh.Trimesh(
        mesh.vertices, mesh.faces, vertex_normals=-mesh.normals, process=False, validate=False
    )
    if mesh.unit is not None:
        made.units = mesh.unit
    return made


def labels_to_trimesh(labels: SurfaceLabels) -> "trimesh.Trimesh":
    """The surface as a trimesh, coloured by label, with every array as a vertex attribute."""
    from trimesh.visual import ColorVisuals

    made = mesh_to_trimesh(labels.mesh)
    arrays = point_arrays(labels)
    made.visual = ColorVisuals(made, vertex_colors=arrays.pop("color"))
    made.vertex_attributes.update(arrays)
    made.metadata["grasp3d"] = settings_of(labels)
    return made
