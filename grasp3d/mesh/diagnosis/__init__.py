"""Diagnosis of meshes: defects, results of repair, and whether labels can be trusted."""

from grasp3d.mesh.diagnosis.diagnosing import check_mesh, diagnose
from grasp3d.mesh.diagnosis.mesh_diagnosis import (
    MeshDiagnosis,
    MeshWarning,
    SurfaceMeasures,
    Trust,
)
from grasp3d.mesh.plausible_lengths import length_warnings

__all__ = [
    "MeshDiagnosis",
    "MeshWarning",
    "SurfaceMeasures",
    "Trust",
    "check_mesh",
    "diagnose",
    "length_warnings",
]
