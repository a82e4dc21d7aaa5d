"""Files of a small report, as a batch writes them."""

import base64
import gzip
import json
import re
from dataclasses import replace
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d import SurfaceLabels, best_grasps
from grasp3d.arrays import Floats
from grasp3d.batch.report import object_script, thumbnail
from grasp3d.batch.row import AreaFractions, BestGrasp, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.settings import DEGREE, GraspModel
from tests.helpers.vertex_labels import with_arrays

FRICTIONS = (0.3, 0.5)
RESOLUTIONS = tuple(10.0 * step * DEGREE for step in range(8))


def with_critical_angles(labels: SurfaceLabels, angles: Floats) -> SurfaceLabels:
    """The same surface with other critical angles, shape (V,), and the same epsilon."""
    changed = with_arrays(labels, angles=(angles, angles))
    vars(changed.grasps)["epsilon_range"] = labels.grasps.epsilon_range
    return changed


def best_of(labels: SurfaceLabels, count: int = 4) -> tuple[BestGrasp, ...]:
    found = best_grasps(labels, count)
    return tuple(
        BestGrasp(
            critical_angle=float(found.critical_angle[k]),
            max_resolution=max(0.0, 2.0 * (labels.model.friction_angle - found.critical_angle[k])),
            epsilon=float(found.epsilon[k]),
            opening=float(found.opening[k]),
            points=tuple(map(tuple, found.contacts.points[k].tolist())),
            normals=tuple(map(tuple, (-found.contacts.normals[k]).tolist())),
        )
        for k in range(len(found.critical_angle))
    )


def row_of(labels: SurfaceLabels, name: str, stem: str) -> Row:
    fractions = labels.fractions()
    median, upper = labels.angle_quantiles((0.5, 0.9))
    # Fingers with a friction of their own have no distribution.
    alike = labels.relabel(per_finger="")
    angles = alike.angle_distribution()
    needed = {
        f"required_resolution_{part}": angles.required_resolution(
            part / 100.0, friction=labels.model.friction
        )
        for part in (50, 80, 90)
    }
    return Row(
        mesh=name,
        view=f"report/objects/{stem}.js",
        thumbnail=f"report/thumbnails/{stem}.webp",
        vertices=len(labels.mesh.vertices),
        faces=len(labels.mesh.faces),
        size=labels.mesh.size,
        unit=labels.mesh.unit,
        stable=fractions["S"],
        ambiguous=fractions["M"],
        no_grasp_found=fractions["U"],
        critical_angle_p50=float(median),
        critical_angle_p90=float(upper),
        epsilon_p50=float(labels.epsilon_quantiles([0.5])[0]),
        fractions=tuple(_fractions(alike, mu, alpha) for mu in FRICTIONS for alpha in RESOLUTIONS),
        warnings="; ".join(labels.mesh.report.warnings),
        seconds=1.25,
        **needed,
    )


def _fractions(labels: SurfaceLabels, friction: float, resolution: float) -> AreaFractions:
    model = GraspModel(friction=friction, sensor_resolution=resolution)
    angles = labels.angle_distribution()
    stable = float(angles.worst_below(model.friction_angle - model.tilt))
    if model.friction_angle + model.tilt > labels.search.cone + 1e-9:
        return AreaFractions(friction, resolution, stable, None, None)
    found = angles.fractions(friction=friction, sensor_resolution=resolution)
    return AreaFractions(friction, resolution, stable, found["M"], found["U"])


def put_object(output: Folder, labels: SurfaceLabels, row: Row) -> Row:
    """Write the script and thumbnail of one mesh; returns its row with the best grasps."""
    grasps = best_of(labels)
    output.write(row.view, object_script(labels, row.mesh, grasps))
    output.write(row.thumbnail, thumbnail(labels))
    return replace(row, grasps=grasps)


def decoded(script: bytes) -> tuple[dict[str, Any], dict[str, npt.NDArray[Any]]]:
    """Header and arrays of a script, as the page reads them."""
    found = re.fullmatch(
        r'grasp3dObject\((\{.*\}),"([A-Za-z0-9+/=]*)"\);\n', script.decode("ascii")
    )
    assert found
    header = json.loads(found[1])
    data = gzip.decompress(base64.b64decode(found[2]))
    arrays, start = {}, 0
    for name, kind, count in header["arrays"]:
        arrays[name] = np.frombuffer(data, f"<{kind}", count, start)
        start += arrays[name].nbytes
    assert start == len(data)
    return header, arrays


def ray_at(camera: dict[str, list[float]], x: float, y: float) -> tuple[Floats, Floats]:
    """Origin and direction of the ray of a click; x to the right, y up, from -1 to 1."""
    ends = np.array([[x, y, -1.0, 1.0], [x, y, 1.0, 1.0]]) @ np.reshape(camera["unproject"], (4, 4))
    start, end = ends[:, :3] / ends[:, 3:] + camera["centre"]
    return start, (end - start) / np.linalg.norm(end - start)
