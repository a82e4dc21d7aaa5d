"""The unit of a mesh, which a hand needs."""

from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.settings.lengths import METRES


def metres_per_unit(mesh: ObjectMesh) -> float:
    """Metres per unit of a mesh.

    Raises:
        SettingError: The unit of the mesh is not known.
    """
    if mesh.unit is None:
        raise SettingError(
            f"a gripper is given in metres, but the unit of {mesh.report.source} is not known: "
            "give the unit of its coordinates (--unit, in Python unit=...)"
        )
    return METRES[mesh.unit]
