"""Where on an object is a grasp reliable for a tactile fingertip of known resolution?

Conventions: positions in the mesh's own unit and frame, normals inward, angles in radians.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from grasp3d.errors import (
        GraspError,
        MeshError,
        OutputError,
        SearchCoverageError,
        SettingError,
    )
    from grasp3d.export import write_glb, write_npz, write_ply, write_vtp
    from grasp3d.mesh import MeshReport, ObjectMesh, load_mesh, mesh_from_arrays
    from grasp3d.settings import GraspModel, MeshOptions, Sampling
    from grasp3d.stability import COLORS, Label
    from grasp3d.surface import Reason, SurfaceLabels, label_surface, scan_surface

_HOMES = {
    "errors": ("GraspError", "MeshError", "OutputError", "SearchCoverageError", "SettingError"),
    "export": ("write_glb", "write_npz", "write_ply", "write_vtp"),
    "mesh": ("MeshReport", "ObjectMesh", "load_mesh", "mesh_from_arrays"),
    "settings": ("GraspModel", "MeshOptions", "Sampling"),
    "stability": ("COLORS", "Label"),
    "surface": ("Reason", "SurfaceLabels", "label_surface", "scan_surface"),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "COLORS",
    "GraspError",
    "GraspModel",
    "Label",
    "MeshError",
    "MeshOptions",
    "MeshReport",
    "ObjectMesh",
    "OutputError",
    "Reason",
    "Sampling",
    "SearchCoverageError",
    "SettingError",
    "SurfaceLabels",
    "label_surface",
    "load_mesh",
    "mesh_from_arrays",
    "scan_surface",
    "write_glb",
    "write_npz",
    "write_ply",
    "write_vtp",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for, so that `grasp3d --help` stays quick."""
    if name not in _HOME_OF:
        raise AttributeError(f"module 'grasp3d' has no attribute {name!r}")
    value = getattr(import_module(f"grasp3d.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
