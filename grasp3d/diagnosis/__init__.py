"""What is wrong with a mesh, what repair makes of it, and whether its labels can be trusted."""

from grasp3d.diagnosis.diagnosing import check_mesh, diagnose
from grasp3d.diagnosis.length_warnings import length_warnings
from grasp3d.diagnosis.mesh_diagnosis import Measured, MeshDiagnosis, MeshWarning, Trust

__all__ = [
    "Measured",
    "MeshDiagnosis",
    "MeshWarning",
    "Trust",
    "check_mesh",
    "diagnose",
    "length_warnings",
]
