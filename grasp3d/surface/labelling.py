"""Labelling of a surface: the best grasp through every vertex, and its reliability."""

from grasp3d.costs import check_cost
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel, Sampling, check_search_settings
from grasp3d.surface.extreme_normals import BEFORE_ENUMERATION, check_combinations_of
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.search import label_multifinger, label_pairs
from grasp3d.system.processors import available_processors
from grasp3d.system.progress import Progress, ignore, within


def label_surface(
    mesh: ObjectMesh,
    model: GraspModel | None = None,
    *,
    sampling: Sampling | None = None,
    threads: int | None = None,
    progress: Progress | None = None,
) -> SurfaceLabels:
    """Find the best grasp through every vertex and label how reliable it is.

    It has `model.fingers` fingers, one at the vertex and the others at the best surface points that
    the search finds. With `model.method` 'extremes' the grasps are the same, but their labels come
    from the wrench hulls at extreme normals alone, as in Wan & Howe 2018.

    Args:
        mesh: The object's surface.
        model: Friction, sensor resolution and number of fingers, 2 to 5.
        sampling: How grasps are searched for.
        threads: Threads to use; None: one per processor. The result does not depend on it.
        progress: Called with the fraction of the work done, from 0 to 1.

    Raises:
        SettingError: The settings contradict each other, there are too many extreme normals, or
            the mesh has fewer vertices than fingers.
        MeshError: Labels for so many fingers would need more memory than the mesh's options allow.
    """
    model, sampling = model or GraspModel(), sampling or Sampling()
    check_search_settings(model, sampling)
    threads = available_processors() if threads is None else threads
    if threads < 1:
        raise SettingError(f"threads must be at least 1; got {threads}")
    report = progress or ignore
    enumerated = model.method == "extremes"
    if enumerated:
        check_combinations_of(model)
    limit, fingers = mesh.options.max_memory, model.fingers
    check_cost(len(mesh.vertices), limit, mesh.report.source, "use a coarser mesh", fingers)
    find = label_pairs if model.fingers == 2 else label_multifinger
    searching = within(report, 0.0, BEFORE_ENUMERATION) if enumerated else report
    labels = find(mesh, model, sampling, threads, searching)
    labels.compute_labels(within(report, BEFORE_ENUMERATION, 1.0))
    return labels
