"""Model the object library of `meshes/` and write its files and its README.

Each function models one object, in millimetres with z up. Plain primitives are meshed in a regular
pattern. Everything else is constructive solid geometry with Manifold, followed by an isotropic
remeshing that keeps the creases. The files are in metres.

    pip install '.[meshes]'
    python scripts/make_meshes.py
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
import pymeshlab
import trimesh
from manifold3d import (
    CrossSection,
    Error,
    FillRule,
    JoinType,
    Manifold,
    Mesh64,
    OpType,
    set_circular_segments,
)
from mmgpy import MmgMeshS
from scipy.interpolate import PchipInterpolator

if TYPE_CHECKING:
    from collections.abc import Callable, Iterable

    from numpy.typing import NDArray

MILLIMETRE = 1e-3
CREASE_DEG = 30.0
DEVIATION = 0.03
LEAST_ANGLE_DEG = 20.0
MOST_VOLUME_CHANGE = 0.01
MOST_DISTANCE = 0.3


# Building blocks


def section(outline: Iterable[tuple[float, float]]) -> CrossSection:
    """Area inside a closed polygon [mm] of either orientation."""
    return CrossSection([list(outline)], FillRule.NonZero)


def rounded(area: CrossSection, radius: float) -> CrossSection:
    """Area with its convex and concave corners rounded to a radius [mm]."""
    for step in (-radius, 2 * radius, -radius):
        area = area.offset(step, JoinType.Round, circular_segments=128)
    return area.simplify(0.005)


def spun(*outline: tuple[float, float], rounding: float) -> Manifold:
    """Body of revolution about z, from (radius, height) points [mm] up its outline, rounded."""
    mirrored = [(-radius, height) for radius, height in reversed(outline)]
    return rounded(section([*outline, *mirrored]), rounding).revolve()


def plate(area: CrossSection, thickness: float) -> Manifold:
    """Plate [mm] with its area in the x-z plane, centred on y = 0."""
    return area.extrude(thickness).translate((0, 0, -thickness / 2)).rotate((90, 0, 0))


def rod(radius: float, start: float, stop: float) -> Manifold:
    """Round bar [mm] along the x axis."""
    return Manifold.cylinder(stop - start, radius).rotate((0, 90, 0)).translate((start, 0, 0))


def around(part: CrossSection, count: int) -> CrossSection:
    """Union of `count` copies of an area, turned evenly about the origin."""
    turned = [part.rotate(360 * k / count) for k in range(count)]
    return CrossSection.batch_boolean(turned, OpType.Add)


def hexagon(across_flats: float) -> CrossSection:
    """Regular hexagon [mm] about the origin, a corner on the x axis."""
    return CrossSection.circle(across_flats / math.sqrt(3), 6)


def stitched(rings: Iterable[tuple[float, float, int, float]]) -> Manifold:
    """Closed surface of revolution about z, triangulated between consecutive rings.

    Args:
        rings: Radius [mm], height [mm], number of points and angle of the first point [steps] of
            each ring, in the order that keeps the solid on the left: up outside, from pole to pole.
    """
    points: list[NDArray[np.float64]] = []
    triangles: list[tuple[int, int, int]] = []
    start, previous = 0, (0, 0, 0.0)
    for radius, height, count, shift in rings:
        angles = 2 * np.pi * (np.arange(count) + shift) / count
        circle = (radius * np.cos(angles), radius * np.sin(angles), np.full(count, height))
        points.append(np.column_stack(circle))
        here = (start, count, shift)
        triangles += _strip(previous, here)
        start, previous = start + count, here
    return Manifold(Mesh64(np.vstack(points), np.array(triangles, dtype=np.uint64)))


def _strip(low: tuple[int, int, float], high: tuple[int, int, float]) -> list[tuple[int, int, int]]:
    """Triangles between two rings, each (first index, number of points, shift of the first one)."""
    (low_start, low_count, low_shift), (high_start, high_count, high_shift) = low, high
    low_steps = low_count if low_count > 1 else 0
    high_steps = high_count if high_count > 1 else 0
    triangles, i, j = [], 0, 0
    while low_count and (i < low_steps or j < high_steps):
        a, b = low_start + i % low_count, high_start + j % high_count
        # The ring whose next point comes first advances; cross-multiplying keeps ties exact. In a
        # tie it is the ring with fewer points, which makes every sector of a disc symmetric.
        low_next = ((i + 1 + low_shift) * high_count, low_count)
        high_next = ((j + 1 + high_shift) * low_count, high_count)
        if j == high_steps or (i < low_steps and low_next <= high_next):
            i += 1
            triangles.append((a, low_start + i % low_count, b))
        else:
            j += 1
            triangles.append((a, high_start + j % high_count, b))
    return triangles


# Plain primitives, meshed as they are


def sphere() -> Manifold:
    """Tennis ball: radius 33.5, centred; an icosahedron, refined and projected onto the sphere."""
    golden = (1 + math.sqrt(5)) / 2
    corners = [(0.0, a, b * golden) for a in (-1, 1) for b in (-1, 1)]
    icosahedron = Manifold.hull_points([p[k:] + p[:k] for p in corners for k in range(3)])
    ball = icosahedron.refine(17)
    return ball.warp_batch(lambda p: 33.5 * p / np.linalg.norm(p, axis=1, keepdims=True))


def box() -> Manifold:
    """Box of 40 x 60 x 100, centred, with a square grid of 20 / 7 on its faces."""
    counts = np.array((14, 21, 35))
    corners = []
    for axis in range(3):
        u, v = (axis + 1) % 3, (axis + 2) % 3
        grid = np.stack(np.meshgrid(np.arange(counts[u]), np.arange(counts[v])), -1).reshape(-1, 2)
        for side, order in ((0, (0, 2, 1, 1, 2, 3)), (counts[axis], (0, 1, 2, 2, 1, 3))):
            square = np.zeros((4, len(grid), 3), dtype=int)
            square[..., axis] = side
            square[..., [u, v]] = grid + np.array(((0, 0), (1, 0), (0, 1), (1, 1)))[:, None]
            corners.append(square[list(order)].swapaxes(0, 1).reshape(-1, 3))
    lattice, index = np.unique(np.vstack(corners), axis=0, return_inverse=True)
    return Manifold(Mesh64((lattice - counts / 2) * 20 / 7, index.reshape(-1, 3).astype(np.uint64)))


def cylinder() -> Manifold:
    """Food can: radius 33, height 110, its base at z = 0."""
    radius, height, rings, rows = 33.0, 110.0, 13, 48
    count = 6 * rings
    base = [(radius * k / rings, 0.0, max(1, 6 * k), 0.0) for k in range(rings)]
    wall = [(radius, height * k / rows, count, k % 2 / 2) for k in range(rows + 1)]
    top = [(r, height, n, shift) for r, _, n, shift in reversed(base)]
    return stitched([*base, *wall, *top])


def cone() -> Manifold:
    """Cone: base radius 30 on z = 0, apex at height 80."""
    radius, height, rings = 30.0, 80.0, 20
    base = [(radius * k / rings, 0.0, max(1, 6 * k), 0.0) for k in range(rings)]
    # Three points more per ring suit the slope: a third of a turn has 42 degrees at the apex.
    side = [
        (radius * k / (2 * rings), height * (1 - k / (2 * rings)), max(1, 3 * k), 0.0)
        for k in range(2 * rings, -1, -1)
    ]
    return stitched([*base, *side])


def torus() -> Manifold:
    """Ring about z: centre circle of radius 35, tube of radius 10, centred."""
    return CrossSection.circle(10, 36).translate((35, 0)).revolve(126)


# Modelled objects, to be remeshed


def mug() -> Manifold:
    """Mug: height 95, radius 40, wall 4, base 5; the finger hole is about 24 x 50."""
    grip = CrossSection.circle(6).translate((28, 0)).revolve().rotate((90, 0, 0))
    handle = grip.scale((1, 1.3, 1.15)).translate((42, 0, 47.5))
    inside = Manifold.cylinder(95, 36).translate((0, 0, 5))
    return Manifold.cylinder(95, 40) + handle - inside


def bottle() -> Manifold:
    """Full bottle with its cap: height 230, radius 33, neck radius 12.5, cap radius 16."""
    outline = [(0, 0), (33, 0), (33, 130), (12.5, 180), (12.5, 226), (0, 226)]
    body = spun(*outline, rounding=12)
    cap = Manifold.cylinder(22, 16).translate((0, 0, 208))
    return body + cap


def bowl() -> Manifold:
    """Bowl: radius 75, height 62, wall 4, on a foot ring of radius 32."""
    shell = CrossSection.circle(75).scale((1, 0.8)) - CrossSection.circle(71).scale((1, 56 / 71))
    half = shell ^ section([(0, 0), (80, 0), (80, -80), (0, -80)])
    foot = section([(27, -62), (32, -62), (32, -52), (27, -52)])
    hollow = CrossSection.circle(71).scale((1, 56 / 71))
    return (half + foot - hollow).revolve().translate((0, 0, 62))


def hammer() -> Manifold:
    """Claw hammer: length 300, head 135 along x; the handle hangs down from the head's centre."""
    handle = spun((0, -286), (17, -286), (15, -200), (11, -100), (11, 8), (0, 8), rounding=6)
    cheek = plate(section([(-14, -14), (14, -14), (14, 14), (-14, 14)]), 30)
    poll = rod(10.5, -35, 0) + rod(15, -52, -30)
    turn = np.linspace(0, 0.95, 80)
    back = 75 * np.column_stack((np.sin(turn), np.cos(turn)))
    belly = back * (1 - np.linspace(20, 4, 80) / 75)[:, None]
    claw = plate(section([*back, *belly[::-1]]).translate((8, -65)), 23)
    notch = rounded(section([(32, 0), (90, 9), (90, -9)]), 1.5).extrude(120)
    return handle.scale((1, 0.75, 1)) + cheek + poll + (claw - notch.translate((0, 0, -80)))


def wrench() -> Manifold:
    """Combination wrench along x: length 215, open jaw and ring both 19, shank 14 x 5."""
    jaw = section([(-40, -9.5), (0, -9.5), (5, 0), (0, 9.5), (-40, 9.5)]).rotate(15)
    open_end = rounded(CrossSection.circle(19.5) - jaw, 1.5).translate((-88, 0))
    ring_end = (CrossSection.circle(15) - hexagon(19)).translate((93, 0))
    shank = section([(-75, -7), (82, -7), (82, 7), (-75, 7)])
    heads = (open_end + ring_end).extrude(8).translate((0, 0, -4))
    return heads + shank.extrude(5).translate((0, 0, -2.5))


def tee() -> Manifold:
    """Hollow pipe tee: run 110 along x, radius 17, bore 13; branch 60 up z, radius 13, bore 9."""
    run = rod(17, -55, 55) + rod(21, -55, -38) + rod(21, 38, 55)
    branch = Manifold.cylinder(60, 13) + Manifold.cylinder(16, 17).translate((0, 0, 44))
    return run + branch - rod(13, -56, 56) - Manifold.cylinder(61, 9)


def knob() -> Manifold:
    """Star knob: radius 31, five lobes, height 38, with a blind bore of radius 5 from below."""
    star = rounded(
        CrossSection.circle(22) + around(CrossSection.circle(9).translate((22, 0)), 5), 4
    )
    dome = Manifold.sphere(70).translate((0, 0, -32))
    head = star.extrude(30).translate((0, 0, 14)) ^ dome
    hub = Manifold.cylinder(20, 13)
    return head + hub - Manifold.cylinder(16, 5).translate((0, 0, -1))


def screwdriver() -> Manifold:
    """Flat screwdriver along z: length 215, fluted handle of radius 15 below, blade 8 x 1.6."""
    flutes = around(CrossSection.circle(5).translate((17, 0)), 6)
    grip = rounded(CrossSection.circle(15) - flutes, 2).extrude(105)
    outline = [(0, 0), (16, 0), (16, 78), (10, 84), (12, 105), (0, 105)]
    handle = grip ^ spun(*outline, rounding=2.5)
    shaft = Manifold.cylinder(90, 3.5).translate((0, 0, 100))
    tip = Manifold.cylinder(1, 3.5).translate((0, 0, 189))
    edge = Manifold.cube((8, 1.6, 1), center=True).translate((0, 0, 214.5))
    return handle + shaft + Manifold.batch_hull([tip, edge])


def banana() -> Manifold:
    """Banana: about 180 long, 36 thick, five blunt edges, bent in the x-z plane, with its stalk."""
    length, bend = 200.0, 110.0
    skin = rounded(CrossSection.circle(19, 5), 8).extrude(1, 400)

    def shape(points: NDArray[np.float64]) -> NDArray[np.float64]:
        along = points[:, 2]
        heights = (0.0, 0.03, 0.12, 0.3, 0.55, 0.75, 0.86, 0.92, 1.0)
        widths = (0.25, 0.38, 0.7, 0.95, 1.0, 0.85, 0.5, 0.33, 0.33)
        width = PchipInterpolator(heights, widths)(along)
        turn = (along - 0.5) * length / bend
        radius = bend + points[:, 0] * width
        return np.column_stack(
            (radius * np.cos(turn) - bend, points[:, 1] * width, radius * np.sin(turn))
        )

    return skin.warp_batch(shape)


def bulb() -> Manifold:
    """Light bulb, upright: height 112, glass radius 30, screw cap of radius 13 below."""
    glass = CrossSection.circle(30).translate((0, 82))
    neck = section([(-13, 25), (13, 25), (24, 64), (-24, 64)])
    body = rounded(glass + neck, 10).revolve()
    cap = [(0, 0), (5, 0), (5, 3), (12, 8)]
    thread = [(r, 9 + 6 * k + dz) for k in range(4) for r, dz in ((13.5, 0), (11.5, 3))]
    return body + spun(*cap, *thread, (13.5, 33), (0, 33), rounding=1.5)


def dumbbell() -> Manifold:
    """Dumbbell along x: length 170, bar of radius 14, hexagonal heads 60 across flats."""
    head = Manifold.batch_hull(
        [hexagon(60).extrude(36), hexagon(50).extrude(46).translate((0, 0, -5))]
    )
    head = head.rotate((0, 90, 0)).translate((44, 0, 0))
    return rod(14, -50, 50) + head + head.mirror((1, 0, 0))


def spray() -> Manifold:
    """Spray bottle: height 245, body 90 x 56; a finger passes behind the trigger."""
    outline = [(0, 0), (45, 0), (45, 130), (14, 175), (14, 190), (0, 190)]
    body = spun(*outline, rounding=9).scale((1, 0.62, 1))
    collar = Manifold.cylinder(24, 18).translate((0, 0, 176))
    side = [(-42, 206), (-30, 245), (38, 245), (44, 216), (22, 212), (21, 192), (-21, 192)]
    head = plate(rounded(section(side), 5), 24)
    lever = [(26, 230), (40, 230), (44, 205), (58, 165), (50, 161), (34, 200)]
    trigger = plate(rounded(section(lever), 2.5), 15)
    nozzle = rod(7, 30, 58).translate((0, 0, 233))
    return body + collar + head + trigger + nozzle


def nut() -> Manifold:
    """Hexagon nut: 46 across flats, height 24, bore of radius 15, corners chamfered by 45 deg."""
    up = Manifold.cylinder(30, 21.5, 51.5)
    down = up.mirror((0, 0, 1)).translate((0, 0, 24))
    blank = hexagon(46).extrude(24) ^ up ^ down
    return blank - Manifold.cylinder(26, 15).translate((0, 0, -1))


@dataclass(frozen=True)
class Item:
    """One object of the library."""

    file: str
    """Name of its file; the suffix chooses the format."""
    model: Callable[[], Manifold]
    """Function that models it [mm]."""
    edge: float | None
    """Longest edge to remesh to [mm]; None for a primitive that has its final triangles."""
    name: str
    """Name of the object."""
    remark: str
    """What it tests."""


LIBRARY = (
    Item("sphere.stl", sphere, None, "tennis ball", "all grasps through the centre are equivalent"),
    Item("box.obj", box, None, "box", "three pairs of parallel faces, three widths"),
    Item("cylinder.ply", cylinder, None, "food can", "held across or by its two ends"),
    Item("cone.off", cone, None, "cone", "two fingers on its flank slide towards the apex"),
    Item("torus.glb", torus, None, "ring", "held by its tube, across, or spread from inside"),
    Item("mug.glb", mug, 5.6, "mug", "a finger fits the handle: held by wall, across, by handle"),
    Item("bottle.off", bottle, 5.0, "bottle with cap", "tall; by the neck, the body or the cap"),
    Item("bowl.ply", bowl, 5.4, "bowl", "too wide for most grippers: held by its thin wall"),
    Item("hammer.ply", hammer, 3.8, "claw hammer", "centre of mass far from the handle"),
    Item("wrench.glb", wrench, 1.9, "combination wrench", "flat and long, jaw and through hole"),
    Item("tee.glb", tee, 4.2, "pipe tee", "hollow, three openings: held across or by a wall"),
    Item("knob.ply", knob, 2.6, "star knob", "five lobes: three fingers on the hollows between"),
    Item("screwdriver.ply", screwdriver, 3.8, "screwdriver", "fluted handle, thin shaft, blade"),
    Item("banana.ply", banana, 3.2, "banana", "bent, tapered and smooth"),
    Item("bulb.glb", bulb, 3.5, "light bulb", "round glass, ribbed cap"),
    Item("dumbbell.stl", dumbbell, 4.8, "dumbbell", "bar between two heads that limit the gripper"),
    Item("spray.glb", spray, 5.0, "spray bottle", "trigger with a gap behind it, elliptic body"),
    Item("nut.obj", nut, 2.3, "hexagon nut", "through hole, parallel flats, chamfers"),
)


# From model to file


def remeshed(model: Manifold, edge: float) -> Manifold:
    """Near-equilateral mesh with creases kept: the best of five nearby edge lengths [mm]."""
    # Mmg repairs the slivers of a boolean only if their long edges are split first.
    fine = model.refine_to_length(edge).to_mesh64()
    candidates = []
    for longest in edge * np.array((1.0, 0.97, 1.03, 0.94, 1.06)):
        mesh = MmgMeshS(fine.vert_properties[:, :3].copy(), fine.tri_verts.astype(np.int32))
        mesh.remesh(
            hmin=longest / 3,
            hmax=longest,
            hausd=DEVIATION * longest,
            hgrad=1.2,
            ar=CREASE_DEG,
            verbose=-1,
        )
        triangles = mesh.get_triangles().astype(np.uint64)
        candidates.append(Manifold(Mesh64(mesh.get_vertices(), triangles)))
    return min(candidates, key=lambda found: (cuts(found), -least_angle(as_trimesh(found))))


def as_trimesh(solid: Manifold) -> trimesh.Trimesh:
    """Trimesh object with the same triangles."""
    mesh = solid.to_mesh64()
    return trimesh.Trimesh(mesh.vert_properties[:, :3], mesh.tri_verts, process=False)


def least_angle(mesh: trimesh.Trimesh) -> float:
    """Smallest corner angle of all triangles [deg]."""
    return math.degrees(mesh.face_angles.min())


def cuts(solid: Manifold) -> int:
    """Number of triangles that intersect another one."""
    mesh = solid.to_mesh64()
    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(mesh.vert_properties[:, :3], mesh.tri_verts))
    meshes.compute_selection_by_self_intersections_per_face()
    return int(meshes.current_mesh().selected_face_number())


def check(file: str, model: Manifold, solid: Manifold) -> None:
    """Refuse a mesh that is not one closed, clean body close to its model [mm]."""
    mesh = as_trimesh(solid)
    meshes = pymeshlab.MeshSet()
    for source in (as_trimesh(model), mesh):
        meshes.add_mesh(pymeshlab.Mesh(source.vertices, source.faces))
    distance = meshes.get_hausdorff_distance(
        sampledmesh=0, targetmesh=1, sampleedge=True, samplenum=20_000
    )["max"]
    faults = {
        "not a manifold": solid.status() != Error.NoError,
        "not watertight": not mesh.is_watertight,
        "winding not consistent": not mesh.is_winding_consistent,
        "not one body": mesh.body_count != 1,
        "holes through it changed": solid.genus() != model.genus(),
        "cuts itself": cuts(solid) > 0,
        "inside out or empty": solid.volume() <= 0,
        "volume changed": abs(solid.volume() / model.volume() - 1) > MOST_VOLUME_CHANGE,
        f"{distance:.3f} mm off its model": distance > MOST_DISTANCE,
        f"angle of {least_angle(mesh):.1f} deg": least_angle(mesh) < LEAST_ANGLE_DEG,
    }
    found = [fault for fault, present in faults.items() if present]
    if found:
        message = f"{file}: {', '.join(found)}"
        raise ValueError(message)


def make(item: Item, folder: Path) -> str:
    """Write the file of an object and return its row of the table, measured on that file."""
    model = item.model()
    solid = model if item.edge is None else remeshed(model, item.edge)
    check(item.file, model, solid)
    mesh = as_trimesh(solid.scale([MILLIMETRE] * 3))
    path = folder / item.file
    mesh.export(path)
    written = trimesh.load_mesh(path)
    size = " x ".join(f"{length / MILLIMETRE:.0f}" for length in written.extents)
    figures = f"{len(written.faces)} | {written.volume * 1e6:.1f} | {least_angle(written):.0f}"
    return f"| {item.file} | {item.name} | {size} | {figures} | {item.remark} |"


README = f"""# Meshes

Objects that people grasp, in metres: closed, one body each, normals outward, no triangle angle
below {LEAST_ANGLE_DEG:.0f} degrees. They were modelled by `scripts/make_meshes.py` (solid geometry,
then remeshed) and are under the MIT licence like the rest of the project. `pip install '.[meshes]'`
and `python scripts/make_meshes.py` generate them and this page.

![All meshes, labelled at friction 0.2 and a sensor resolution of 15 degrees](gallery.png)

`python scripts/make_gallery.py meshes` generates the picture.

| file | object | size [mm] | triangles | volume [cm3] | least angle [deg] | what it tests |
|---|---|---|---|---|---|---|
"""


def main() -> None:
    """Write all meshes and their README."""
    parser = argparse.ArgumentParser(description="Model the object library.")
    default = Path(__file__).resolve().parents[1] / "meshes"
    parser.add_argument("--out", type=Path, default=default, help="folder to write to")
    folder = parser.parse_args().out
    folder.mkdir(parents=True, exist_ok=True)
    # The model's facets must be much finer than the edges of the final mesh.
    set_circular_segments(256)
    rows = []
    for item in LIBRARY:
        rows.append(make(item, folder))
        print(rows[-1], flush=True)
    (folder / "README.md").write_text(README + "\n".join(rows) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
