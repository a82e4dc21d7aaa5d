"""Where on an object is a grasp reliable for a tactile fingertip of known resolution?

Conventions: positions in the mesh's own unit and frame, normals inward, angles in radians.
"""

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from grasp3d import planar
    from grasp3d.batch.library import LibraryLabels, label_library
    from grasp3d.batch.settings import BatchSettings, ClusterSettings, ShareGrid
    from grasp3d.batch.store import read_summary
    from grasp3d.classification import Stability, classify
    from grasp3d.cones import effective_friction
    from grasp3d.contacts import Contacts
    from grasp3d.critical import critical_friction_angle
    from grasp3d.diagnosis import MeshDiagnosis, Trust, check_mesh
    from grasp3d.distributions import AngleDistribution, SphereAngles, accuracy_ceiling
    from grasp3d.errors import (
        ContactError,
        GraspError,
        MeshError,
        OutputError,
        SearchCoverageError,
        SettingError,
    )
    from grasp3d.export import write_fields, write_glb, write_npz, write_ply, write_vtp
    from grasp3d.grasps.distinct import best_grasps
    from grasp3d.grasps.evaluation import evaluate_grasps
    from grasp3d.grasps.reading import read_contacts
    from grasp3d.grasps.surface_grasps import SurfaceGrasps
    from grasp3d.grasps.writing import write_grasps
    from grasp3d.labels import Reason, SurfaceLabels
    from grasp3d.mesh import MeshReport, ObjectMesh, load_mesh, mesh_from_arrays
    from grasp3d.quality import (
        Certificate,
        Closure,
        Epsilon,
        Minimum,
        Status,
        epsilon,
        epsilon_of_wrenches,
        force_closure,
        minimum,
    )
    from grasp3d.sensor import Sensor, resolution_limit
    from grasp3d.settings import GraspModel, MeshOptions, Sampling
    from grasp3d.stability import COLORS, Label
    from grasp3d.surface import label_surface, scan_surface
    from grasp3d.surface_contacts import SurfaceContacts
    from grasp3d.sweeps import Sweep, mean_sweep, sweep, write_sweeps
    from grasp3d.tilting import EpsilonRange, epsilon_range
    from grasp3d.viewer.settings import ViewSettings

_HOMES = {
    "batch.library": ("LibraryLabels", "label_library"),
    "batch.settings": ("BatchSettings", "ClusterSettings", "ShareGrid"),
    "batch.store": ("read_summary",),
    "classification": ("Stability", "classify"),
    "cones": ("effective_friction",),
    "contacts": ("Contacts",),
    "critical": ("critical_friction_angle",),
    "diagnosis": ("MeshDiagnosis", "Trust", "check_mesh"),
    "distributions": ("AngleDistribution", "SphereAngles", "accuracy_ceiling"),
    "errors": (
        "ContactError",
        "GraspError",
        "MeshError",
        "OutputError",
        "SearchCoverageError",
        "SettingError",
    ),
    "export": ("write_fields", "write_glb", "write_npz", "write_ply", "write_vtp"),
    "grasps.distinct": ("best_grasps",),
    "grasps.evaluation": ("evaluate_grasps",),
    "grasps.reading": ("read_contacts",),
    "grasps.surface_grasps": ("SurfaceGrasps",),
    "grasps.writing": ("write_grasps",),
    "labels": ("Reason", "SurfaceLabels"),
    "mesh": ("MeshReport", "ObjectMesh", "load_mesh", "mesh_from_arrays"),
    "quality": (
        "Certificate",
        "Closure",
        "Epsilon",
        "Minimum",
        "Status",
        "epsilon",
        "epsilon_of_wrenches",
        "force_closure",
        "minimum",
    ),
    "sensor": ("Sensor", "resolution_limit"),
    "settings": ("GraspModel", "MeshOptions", "Sampling"),
    "stability": ("COLORS", "Label"),
    "surface": ("label_surface", "scan_surface"),
    "surface_contacts": ("SurfaceContacts",),
    "sweeps": ("Sweep", "mean_sweep", "sweep", "write_sweeps"),
    "tilting": ("EpsilonRange", "epsilon_range"),
    "viewer.settings": ("ViewSettings",),
}
_ROOMS = ("planar",)
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "COLORS",
    "AngleDistribution",
    "BatchSettings",
    "Certificate",
    "Closure",
    "ClusterSettings",
    "ContactError",
    "Contacts",
    "Epsilon",
    "EpsilonRange",
    "GraspError",
    "GraspModel",
    "Label",
    "LibraryLabels",
    "MeshDiagnosis",
    "MeshError",
    "MeshOptions",
    "MeshReport",
    "Minimum",
    "ObjectMesh",
    "OutputError",
    "Reason",
    "Sampling",
    "SearchCoverageError",
    "Sensor",
    "SettingError",
    "ShareGrid",
    "SphereAngles",
    "Stability",
    "Status",
    "SurfaceContacts",
    "SurfaceGrasps",
    "SurfaceLabels",
    "Sweep",
    "Trust",
    "ViewSettings",
    "accuracy_ceiling",
    "best_grasps",
    "check_mesh",
    "classify",
    "critical_friction_angle",
    "effective_friction",
    "epsilon",
    "epsilon_of_wrenches",
    "epsilon_range",
    "evaluate_grasps",
    "force_closure",
    "label_library",
    "label_surface",
    "load_mesh",
    "mean_sweep",
    "mesh_from_arrays",
    "minimum",
    "planar",
    "read_contacts",
    "read_summary",
    "resolution_limit",
    "scan_surface",
    "sweep",
    "write_fields",
    "write_glb",
    "write_grasps",
    "write_npz",
    "write_ply",
    "write_sweeps",
    "write_vtp",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first asked for, so that `grasp3d --help` stays quick."""
    if name in _ROOMS:
        return import_module(f"grasp3d.{name}")
    if name not in _HOME_OF:
        raise AttributeError(f"module 'grasp3d' has no attribute {name!r}")
    value = getattr(import_module(f"grasp3d.{_HOME_OF[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
