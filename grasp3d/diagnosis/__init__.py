"""What is wrong with a mesh, what repair makes of it, and whether its labels can be trusted."""

from grasp3d.diagnosis.diagnosing import check_mesh, diagnose
from grasp3d.diagnosis.lengths import length_doubts
from grasp3d.diagnosis.record import Doubt, Measured, MeshDiagnosis, Trust

__all__ = [
    "Doubt",
    "Measured",
    "MeshDiagnosis",
    "Trust",
    "check_mesh",
    "diagnose",
    "length_doubts",
]
