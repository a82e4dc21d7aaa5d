"""Accuracy of the search for two fingers, compared with very many rays.

The critical angle of a grasp is exact, so a search can only miss better grasps. At randomly chosen
smooth vertices this traces 20,000 rays, spread evenly over the search cone, through all crossings
with the surface (trimesh and Embree, independently of the search), and takes the smallest critical
angle of their exits. It prints the fractions of vertices at which the search is worse by more than
0.5 and 2 degrees, the largest and the median difference, negative where the search is better, and
the CPU time of the search.

The shapes are thin or organic, made by this script: their best grasps lie on features that are seen
under small solid angles. Mesh files may be given instead.

    python scripts/bench_search.py [MESH ...]
"""

import argparse
import math
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table

from grasp3d import GraspModel, ObjectMesh, label_surface, load_mesh, running

RAYS = 20_000
VERTICES = 120
MODEL = GraspModel(friction=0.5, sensor_resolution=math.radians(22.6))
CONE = math.atan(MODEL.friction) + MODEL.sensor_resolution / 2.0
STEPS = (0.5, 2.0)


def blob() -> trimesh.Trimesh:
    """Return a ball with bumps of several sizes, as an organic scan has."""
    mesh = trimesh.creation.icosphere(subdivisions=5, radius=0.05)
    rng = np.random.default_rng(2)
    unit = mesh.vertices / 0.05
    height = np.zeros(len(unit))
    for wave_number in (2.0, 4.0, 8.0, 16.0):
        for axis in rng.normal(size=(4, 3)):
            phase = wave_number * unit @ axis / np.linalg.norm(axis) + rng.uniform(0, 6)
            height += 0.12 / wave_number * np.sin(phase)
    mesh.vertices *= (1.0 + height)[:, None]
    return mesh


def comb() -> trimesh.Trimesh:
    """Return a bar with thin teeth."""
    boxes = [trimesh.creation.box((0.12, 0.01, 0.02))]
    for k in range(9):
        tooth = trimesh.creation.box((0.002, 0.05, 0.008))
        tooth.apply_translation((-0.048 + 0.012 * k, 0.029, 0.0))
        boxes.append(tooth)
    return trimesh.boolean.union(boxes, engine="manifold")


def ribbon() -> trimesh.Trimesh:
    """Return a thin twisted strip."""
    mesh = trimesh.creation.box((0.15, 0.02, 0.0015)).subdivide_to_size(0.004)
    turn = 20.0 * mesh.vertices[:, 0]
    y, z = mesh.vertices[:, 1].copy(), mesh.vertices[:, 2].copy()
    mesh.vertices[:, 1] = np.cos(turn) * y - np.sin(turn) * z
    mesh.vertices[:, 2] = np.sin(turn) * y + np.cos(turn) * z
    return mesh


def scissors() -> trimesh.Trimesh:
    """Return two crossing blades with rings."""
    parts = []
    for side in (-1.0, 1.0):
        blade = trimesh.creation.cone(radius=0.008, height=0.12, sections=24)
        blade.apply_scale((1.0, 0.25, 1.0))
        ring = trimesh.creation.torus(major_radius=0.014, minor_radius=0.003)
        ring.apply_transform(trimesh.transformations.rotation_matrix(math.pi / 2.0, (1, 0, 0)))
        ring.apply_translation((0.0, 0.0, -0.012))
        for part in (blade, ring):
            part.apply_transform(
                trimesh.transformations.rotation_matrix(side * 0.2, (0, 1, 0), (0, 0, 0.05))
            )
            parts.append(part)
    return trimesh.boolean.union(parts, engine="manifold")


def made_meshes() -> Iterator[tuple[str, ObjectMesh]]:
    """Yield the script's own shapes, by way of files as users have them."""
    with tempfile.TemporaryDirectory() as folder:
        for make in (blob, comb, ribbon, scissors):
            path = Path(folder) / f"{make.__name__}.ply"
            make().export(path)
            yield make.__name__, load_mesh(path)


def smallest_angles(mesh: ObjectMesh, vertices: np.ndarray) -> np.ndarray:
    """Critical angle of the best exit of the rays from each vertex [rad], inf without one. (n,)."""
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    corners = mesh.corner_normals
    angles = np.full(len(vertices), math.inf)
    for row, vertex in enumerate(vertices):
        normal, directions = mesh.normals[vertex], cone_directions(mesh.normals[vertex])
        origins = np.broadcast_to(mesh.vertices[vertex] + 1e-6 * mesh.size * normal, (RAYS, 3))
        points, rays, faces = surface.ray.intersects_location(origins, directions)
        weights = trimesh.triangles.points_to_barycentric(surface.triangles[faces], points)
        inward = np.einsum("ij,ijk->ik", weights, corners.normals[corners.corners[faces]])
        inward /= np.linalg.norm(inward, axis=1, keepdims=True)
        lines = directions[rays]
        exits = np.einsum("ij,ij->i", surface.face_normals[faces], lines) > 0.0
        cosines = np.minimum(lines @ normal, -np.einsum("ij,ij->i", inward, lines))[exits]
        if len(cosines):
            angles[row] = math.acos(min(cosines.max(), 1.0))
    return angles


def cone_directions(normal: np.ndarray) -> np.ndarray:
    """Spread directions evenly over the search cone about a normal, shape (RAYS, 3)."""
    step = (np.arange(RAYS) + 0.5) / RAYS
    cosine = 1.0 - (1.0 - math.cos(CONE)) * step
    azimuth = math.pi * (1.0 + math.sqrt(5.0)) * np.arange(RAYS)
    across = np.linalg.svd(normal[None])[2][1:]
    around = np.cos(azimuth)[:, None] * across[0] + np.sin(azimuth)[:, None] * across[1]
    return cosine[:, None] * normal + np.sqrt(1.0 - cosine**2)[:, None] * around


def main() -> None:
    """Search each mesh, compare chosen vertices with rays, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path)
    paths = parser.parse_args().meshes
    meshes = ((path.name, load_mesh(path)) for path in paths) if paths else made_meshes()
    worse = [f"> {step} °" for step in STEPS]
    table = Table("mesh", "vertices", "CPU time", *worse, "largest", "median")
    everything = []
    for name, mesh in meshes:
        if not everything:
            label_surface(mesh, MODEL)  # compiles
        start = time.process_time()
        labels = label_surface(mesh, MODEL)
        seconds = time.process_time() - start
        smooth = np.flatnonzero((mesh.normal_sets.counts == 1) & mesh.on_surface)
        rng = np.random.default_rng(7)
        chosen = rng.choice(smooth, min(VERTICES, len(smooth)), replace=False)
        found = np.minimum(labels.critical_angle[chosen], CONE)
        excess = np.degrees(found - np.minimum(smallest_angles(mesh, chosen), CONE))
        everything.append(excess)
        add_row(table, name, len(mesh.vertices), f"{seconds:.2f} s", excess)
    add_row(table, "all", 0, "", np.concatenate(everything))
    Console().print(table)


def add_row(table: Table, name: str, vertices: int, seconds: str, excess: np.ndarray) -> None:
    """Add the differences of one mesh [degrees]."""
    fractions = (f"{100.0 * np.mean(excess > step):.2f} %" for step in STEPS)
    size = f"{vertices:,}" if vertices else ""
    table.add_row(
        name, size, seconds, *fractions, f"{excess.max():.2f}°", f"{np.median(excess):.3f}°"
    )


if __name__ == "__main__":
    with running(threads=1):
        main()
