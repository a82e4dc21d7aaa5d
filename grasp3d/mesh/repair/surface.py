"""Repair of a surface: the sequence of steps at each level."""

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh.repair.records import RepairedSurface
from grasp3d.mesh.repair.work import Work
from grasp3d.mesh.work_bounds import WorkBoundError
from grasp3d.settings import Repair


def repair_surface(vertices: Floats, faces: Ints, level: Repair, where: str) -> RepairedSurface:
    """Repair a surface as far as a level allows.

    Args:
        vertices: Positions (V, 3), finite.
        faces: Vertices of each face (F, 3).
        level: How much may be changed.
        where: Name of the mesh in errors.

    Raises:
        MeshError: No face remains.
        WorkBoundError: A step would take too long.
    """
    work = Work(vertices, faces, where, apart=level != "none")
    if level == "none":
        work.leave_out_flat()
        work.note_solids()
        done = {str(step) for step in work.steps}
        try:
            safe = repair_surface(vertices, faces, "safe", where)
        except WorkBoundError as error:
            work.warnings = [f"not repaired, as requested; repair 'safe' would be refused: {error}"]
            return work.result()
        work.warnings = [
            f"not repaired, as requested; repair 'safe' would do this: {step}"
            for step in safe.steps
            if str(step) not in done
        ]
        return work.result()
    work.weld()
    work.leave_out_repeated()
    work.wind()
    work.leave_out_needles()
    work.fill(only_small=True)
    if level == "full":
        work.fill(only_small=False)
    work.leave_out_copies()
    work.turn_outward()
    if level == "full":
        work.fill_cavities()
    work.note_solids()
    work.unite()
    work.leave_out_flat()
    return work.result()
