"""A small report in a folder, as a batch would write it."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

from grasp3d import SurfaceLabels, best_grasps
from grasp3d.batch.report import object_script, thumbnail
from grasp3d.batch.row import BestGrasp, Row, Share
from grasp3d.settings import DEGREE, GraspModel

FRICTIONS = (0.3, 0.5)
RESOLUTIONS = tuple(10.0 * step * DEGREE for step in range(8))


@dataclass(frozen=True)
class Local:
    """A folder of this machine."""

    home: Path

    def write(self, name: str, data: bytes) -> None:
        path = self.home / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)


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
    shares = labels.fractions()
    median, upper = labels.angle_quantiles((0.5, 0.9))
    angles = labels.angle_distribution()
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
        stable=shares["S"],
        ambiguous=shares["M"],
        no_grasp_found=shares["U"],
        critical_angle_p50=float(median),
        critical_angle_p90=float(upper),
        epsilon_p50=float(labels.epsilon_quantiles([0.5])[0]),
        shares=tuple(_share(labels, mu, alpha) for mu in FRICTIONS for alpha in RESOLUTIONS),
        warnings="; ".join(labels.mesh.report.warnings),
        seconds=1.25,
        **needed,
    )


def _share(labels: SurfaceLabels, friction: float, resolution: float) -> Share:
    model = GraspModel(friction=friction, sensor_resolution=resolution)
    angles = labels.angle_distribution()
    stable = float(angles.worst_below(model.friction_angle - model.tilt))
    if model.friction_angle + model.tilt > labels.search.cone + 1e-9:
        return Share(friction, resolution, stable, None, None)
    told = angles.fractions(friction=friction, sensor_resolution=resolution)
    return Share(friction, resolution, stable, told["M"], told["U"])


def put_object(output: Local, labels: SurfaceLabels, row: Row) -> Row:
    """Write what the report shows of one mesh; the row, with its best grasps."""
    grasps = best_of(labels)
    output.write(row.view, object_script(labels, row.mesh, grasps))
    output.write(row.thumbnail, thumbnail(labels))
    return replace(row, grasps=grasps)


def ray_at(camera: dict[str, list[float]], x: float, y: float) -> tuple[list[float], list[float]]:
    """Where the ray of a click begins and where it goes; x to the right, y up, from -1 to 1."""

    def unprojected(depth: float) -> list[float]:
        into = camera["unproject"]
        at = [sum(into[4 * k + i] * (x, y, depth, 1.0)[k] for k in range(4)) for i in range(4)]
        return [at[i] / at[3] + camera["centre"][i] for i in range(3)]

    start, end = unprojected(-1.0), unprojected(1.0)
    way = [b - a for a, b in zip(start, end, strict=True)]
    return start, [part / math.hypot(*way) for part in way]
