import math
import os
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
import pyvista
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, Sampling, SurfaceLabels, label_surface, scan_surface
from grasp3d.mesh import load_mesh
from grasp3d.pictures.camera import axes_of
from grasp3d.pictures.captions import ACROSS, DOWN, MAX_SIZE, MIN_SIZE, round_length
from grasp3d.pictures.opengl import can_render, choose_window, new_plotter, off_screen
from grasp3d.pictures.pane import Pane
from grasp3d.pictures.subject import Subject, subject_of
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.stability.label import COLORS
from grasp3d.viewer.collection import Collection, Item, Section, collection_of
from grasp3d.viewer.inspection import inspect
from grasp3d.viewer.scene import Scene, captions_of
from grasp3d.viewer.session import Session
from tests.helpers import shapes, viewing
from tests.helpers.solids import box_mesh, cylinder_mesh, sphere_mesh
from tests.helpers.viewing import ready_session

Image = NDArray[np.uint8]
Floats = NDArray[np.float64]

# In continuous integration missing OpenGL is a failure.
needs_opengl = pytest.mark.skipif(not (os.environ.get("CI") or can_render()), reason="needs OpenGL")

WIDE, HIGH = 400, 320
TIMEOUT = 120.0


@cache
def scanned(degrees: float = 15.0, subdivisions: int = 3) -> SurfaceLabels:
    """A sphere scanned with a finger at its lowest point: β* is half the angle from the top."""
    model = GraspModel(friction=1.0, sensor_resolution=math.radians(degrees))
    return scan_surface(sphere_mesh(subdivisions=subdivisions), model, fixed=(0.0, 0.0, -1.0))


@cache
def held_box() -> SurfaceLabels:
    model = GraspModel(friction=1.0, sensor_resolution=math.radians(15.0))
    return scan_surface(box_mesh((1.0, 2.0, 3.0), max_edge=0.5), model, fixed=(0.0, 0.0, -1.5))


def until(done: Callable[[], bool]) -> None:
    late = time.monotonic() + TIMEOUT
    while not done():
        assert time.monotonic() < late
        time.sleep(0.005)


def ready(session: Session) -> None:
    until(lambda: (session.poll() and False) or session.working is None)


@contextmanager
def viewed(
    collection: Collection,
    *,
    legend: bool = False,
    width: int = WIDE,
    height: int = HIGH,
    **how: object,
) -> Iterator[tuple[Session, Scene]]:
    choose_window()
    how = {"azimuth": 0.0, "elevation": 0.0} | how
    session = Session(collection, ViewSettings(width=width, height=height, **how))
    ready(session)
    plotter = new_plotter(width, height)
    try:
        scene = Scene(plotter, legend=legend)
        scene.update(session)
        yield session, scene
    finally:
        session.close()
        plotter.close()


def after(session: Session, scene: Scene, **choices: object) -> Image:
    session.change(**choices)
    ready(session)
    scene.update(session)
    return scene.screenshot()


def coloured(image: Image) -> NDArray[np.bool_]:
    """Pixels that are not grey: the coloured surface."""
    return np.asarray(np.ptp(image.astype(int), axis=2) > 40)


def nearest_label(pixels: Image) -> NDArray[np.int64]:
    palette = np.array([COLORS[label] for label in sorted(Label)], dtype=float)
    hues = palette / np.linalg.norm(palette, axis=1, keepdims=True)
    lengths = np.linalg.norm(pixels.astype(float), axis=-1, keepdims=True)
    return np.asarray((pixels / lengths @ hues.T).argmax(axis=-1))


def pixel_coordinates(scene: Scene, image: Image) -> tuple[Floats, Floats]:
    """Coordinates to the right and upward of the points of the unit sphere that pixels show."""
    rows, columns = np.nonzero(coloured(image))
    radius = (np.ptp(columns) + 1) / 2.0
    assert radius == pytest.approx((np.ptp(rows) + 1) / 2.0, abs=1.0)
    assert radius == pytest.approx(image.shape[0] / (2.0 * scene.camera.parallel_scale), abs=1.0)
    right = (np.arange(image.shape[1]) - (columns.min() + columns.max()) / 2.0) / radius
    up = -(np.arange(image.shape[0]) - (rows.min() + rows.max()) / 2.0) / radius
    return tuple(np.meshgrid(right, up))


@needs_opengl
def test_every_pixel_has_the_label_of_its_point_after_every_change() -> None:
    with viewed(collection_of(scanned(subdivisions=5))) as (session, scene):
        for degrees, friction in ((15.0, 1.0), (40.0, 1.0), (15.0, 0.6)):
            image = after(
                session, scene, sensor_resolution=math.radians(degrees), friction=friction
            )
            y, z = pixel_coordinates(scene, image)
            inside = np.hypot(y, z) < 0.97
            critical = np.arccos(np.clip(z, -1.0, 1.0)) / 2.0
            model = session.model
            expected = np.full(z.shape, int(Label.M))
            expected[critical < model.friction_angle - model.tilt] = Label.S
            expected[critical >= model.friction_angle + model.tilt] = Label.U
            assert (nearest_label(image[inside]) == expected[inside]).mean() > 0.985


@needs_opengl
def test_a_stale_surface_is_pale_and_has_no_grasp() -> None:
    with viewed(collection_of(held_box())) as (session, scene):
        session.click(3)
        scene.update(session)
        bright = scene.screenshot()
        session.change(fingers=3)
        assert session.stale
        scene.update(session)
        pale = scene.screenshot()
        assert coloured(bright).sum() > 5000
        assert not coloured(pale[..., :3]).any() or np.ptp(pale.astype(int), axis=2).max() < 80
        assert (pale < 60).all(axis=2).sum() < 0.5 * (bright < 60).all(axis=2).sum()
        session.change(fingers=2)
        scene.update(session)
        assert (scene.screenshot() == bright).all()


def pixel_of(scene: Scene, point: Floats) -> tuple[int, int]:
    """Row and column of the pixel that shows a point."""
    renderer = scene.plotter.renderers[0]
    renderer.SetWorldPoint(*point, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    return round(scene.plotter.window_size[1] - 1 - y), round(x)


@needs_opengl
def test_a_grasp_is_marked_and_its_hidden_part_is_faint() -> None:
    labels = scanned()
    with viewed(collection_of(labels)) as (session, scene):
        plain = scene.screenshot().astype(int)
        subject = session.subject
        assert subject is not None
        pane = Pane(scene.plotter.renderers[0])
        pane.show(subject, "label")
        pane.cut(None)
        front, back = np.array([0.5, 0.8, 0.3]), np.array([-0.5, -0.6, -0.3])
        front, back = front / np.linalg.norm(front), back / np.linalg.norm(back)
        grasp = replace(
            inspect(subject, 0), points=np.array([front, back]),
            normals=np.array([back, front]),
        )  # fmt: skip
        pane.hold(grasp, None, None)
        image = scene.screenshot().astype(int)
        assert image[pixel_of(scene, front)].min() > 240
        hidden = image[pixel_of(scene, back)]
        assert (hidden > plain[pixel_of(scene, back)] + 20).all()
        assert hidden.min() < 240
        # The cones are outside: seen from the side they reach beyond the sphere.
        assert (np.abs(image - plain).max(axis=2) > 25).sum() > 300
        wide = (np.abs(image - plain).max(axis=2) > 25).sum()
        lone = replace(grasp, points=front[None], normals=back[None])
        pane.hold(lone, None, None)
        image = scene.screenshot().astype(int)
        assert image[pixel_of(scene, front)].min() > 240
        assert 20 < (np.abs(image - plain).max(axis=2) > 25).sum() < 0.4 * wide
        pane.hold(None, None, None)
        assert (scene.screenshot() == plain).all()


def test_settings_contain_the_largest_opening_if_it_is_limited() -> None:
    for labels, settings in (
        (viewing.labels(), "α 22.6°   μ 0.75   two fingers   opening ≤ 3 mm"),
        (viewing.box(), "α 22.6°   μ 0.5   two fingers"),
        (viewing.scan(), "α 22.6°   μ 0.5   two fingers"),
    ):
        session = ready_session(labels)
        assert captions_of(session, None, legend=True).settings == settings
        session.close()


@needs_opengl
def test_faces_just_within_a_limit_have_the_colour_of_their_labels() -> None:
    mesh = load_mesh(shapes.box((0.04, 0.06, 0.08)))
    # S below 0.01 degrees: only grasps on exactly parallel faces are S.
    model = GraspModel(friction=0.2, sensor_resolution=math.radians(22.6))
    labels = label_surface(mesh, model)
    assert labels.fractions()["S"] > 0.8
    with viewed(collection_of(labels)) as (_, scene):
        image = scene.screenshot()
        drawn = nearest_label(image[coloured(image)])
    assert (drawn == Label.S).mean() > 0.8


@needs_opengl
def test_a_section_opens_the_object_and_shows_its_inside() -> None:
    with viewed(collection_of(held_box())) as (session, scene):
        whole = coloured(scene.screenshot())
        middle = pixel_of(scene, np.array([0.5, 0.0, 0.0]))
        assert whole[middle]
        behind = after(session, scene, section=Section("x", 0.5))
        assert not coloured(behind)[middle]
        assert 60 < behind[middle].max() < 180  # the back of the far faces
        assert int(behind[middle][0]) > int(behind[middle][2])
        before = after(session, scene, section=Section("x", 0.5, flipped=True))
        assert (coloured(before) & whole).sum() > 0.97 * whole.sum()
        upper = after(session, scene, section=Section("z", 0.75, flipped=True))
        rows = np.nonzero(coloured(upper).any(axis=1))[0]
        all_rows = np.nonzero(whole.any(axis=1))[0]
        assert np.ptp(rows) == pytest.approx(0.25 * np.ptp(all_rows), abs=3.0)
        assert rows.min() == all_rows.min()
        assert (coloured(after(session, scene, section=None)) == whole).all()


@needs_opengl
def test_a_section_is_relative_to_the_faces_and_not_to_unused_vertices() -> None:
    points, faces = shapes.box((1.0, 1.0, 1.0))
    mesh = load_mesh((np.concatenate([points, [[0.0, 100.0, 0.0]]]), faces))
    with viewed(collection_of(label_surface(mesh))) as (session, scene):
        whole = coloured(scene.screenshot()).sum()
        assert whole > 0.1 * scene.screenshot()[..., 0].size
        half = coloured(after(session, scene, section=Section("y", 0.5))).sum()
        assert 0.3 * whole < half < 0.95 * whole


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize("size", [(320, 240), (640, 400), (500, 700)])
def test_the_object_fills_its_pane_without_overlapping_texts(size: tuple[int, int]) -> None:
    width, height = size
    how = {"width": width, "height": height, "elevation": 0.4, "azimuth": 1.0}
    with viewed(collection_of(held_box()), legend=True, **how) as (session, scene):
        image = scene.screenshot()
        points = session.subject.mesh.vertices  # type: ignore[union-attr]
        seen = points @ axes_of(scene.camera)[:2].T
        scale = height / (2.0 * scene.camera.parallel_scale)
        wide, tall = scale * np.ptp(seen, axis=0)
        corners = np.array([pixel_of(scene, point) for point in points])
        top, left = corners.min(axis=0)
        bottom, right = corners.max(axis=0)
        assert 0 < left < right < width
        assert 0 < top < bottom < height
        text = min(MAX_SIZE, max(MIN_SIZE, min(width / ACROSS, height / DOWN)))
        free = captions_of(session, None, legend=True).free_area(width, height, text)
        filled = max(wide / free.free[0], tall / free.free[1])
        assert 0.93 < filled <= 1.0
        assert free.top - 1 < top
        assert bottom < height - free.bottom + 1
        box = np.zeros(image.shape[:2], dtype=bool)
        box[top : bottom + 1, left : right + 1] = True
        rows = np.nonzero((image < 250).any(axis=2).any(axis=1))[0]
        assert not {top - 2, bottom + 2} & set(rows)  # between the texts and the object


def make_item(labels: SurfaceLabels, name: str, gate: threading.Event | None = None) -> Item:
    def open_item() -> Subject:
        assert gate is None or gate.wait(TIMEOUT)
        return subject_of(labels, name)

    return Item(name, open_item)


@needs_opengl
def test_the_view_is_reset_for_another_object_only() -> None:
    gate = threading.Event()
    ball, box = scanned(), held_box()
    collection = Collection(
        (make_item(ball, "ball"), make_item(box, "box", gate)), ball.model, Sampling()
    )
    with viewed(collection) as (session, scene):
        first = scene.camera.parallel_scale
        scene.camera.parallel_scale = 0.7 * first
        session.change(friction=0.9)
        scene.update(session)
        assert scene.camera.parallel_scale == pytest.approx(0.7 * first)
        session.step(1)
        scene.update(session)
        waiting = scene.screenshot()
        assert not coloured(waiting).any()  # no object, and a sentence in the middle
        rows, columns = np.nonzero((waiting < 200).all(axis=2))
        assert rows.mean() == pytest.approx(HIGH / 2, abs=12)
        assert columns.mean() == pytest.approx(WIDE / 2, abs=12)
        gate.set()
        ready(session)
        scene.update(session)
        assert coloured(scene.screenshot()).any()
        assert scene.camera.parallel_scale > 1.1 * first
        session.step(1)
        ready(session)
        scene.update(session)
        assert scene.camera.parallel_scale == pytest.approx(first)


@given(st.floats(1e-9, 1e9))
def test_a_round_length_is_the_largest_that_fits(most: float) -> None:
    length = round_length(most)
    digit = length / 10.0 ** math.floor(math.log10(length) + 1e-9)
    assert min(abs(digit - one) for one in (1.0, 2.0, 5.0)) < 1e-6
    assert length <= most * (1.0 + 1e-8)
    assert most < 2.5 * length * (1.0 + 1e-8)


def hit_vertex(
    subject: Subject, origin: Floats, way: Floats, section: Section | None
) -> int | None:
    """The expected vertex, from tests of all faces (Moeller & Trumbore 1997)."""
    corners = subject.mesh.vertices[subject.mesh.faces]
    first, second = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    across = np.cross(way, second)
    scale = (first * across).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        gap = origin - corners[:, 0]
        u = (gap * across).sum(axis=1) / scale
        turned = np.cross(gap, first)
        v = turned @ way / scale
        t = (second * turned).sum(axis=1) / scale
    hit = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t >= 0.0)
    if section is not None:
        point, normal = section.plane(subject.bounds)
        hit &= (origin + np.where(hit, t, 0.0)[:, None] * way - point) @ normal >= 0.0
    if not hit.any():
        return None
    face = int(np.argmin(np.where(hit, t, np.inf)))
    gaps = np.linalg.norm(corners[face] - (origin + t[face] * way), axis=1)
    return int(subject.mesh.faces[face, np.argmin(gaps)])


@cache
def cut_cylinder(offset: float) -> Subject:
    mesh = cylinder_mesh(0.5, 2.0, max_edge=0.5)
    moved = load_mesh((mesh.vertices + offset, mesh.faces), max_edge=1.0)
    return subject_of(scan_surface(moved, fixed=(offset, offset, offset - 1.0)))


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize(
    ("section", "offset"),
    [
        (None, 0.0),
        (Section("x", 0.5), 0.0),
        (Section("y", 0.37, flipped=True), 1e4),
        (Section("z", 0.8), 1e4),
    ],
)
def test_a_click_hits_the_vertex_found_by_testing_all_faces(
    section: Section | None, offset: float
) -> None:
    subject = cut_cylinder(offset)
    item = Item("cylinder", lambda: subject)
    session = Session(Collection((item,), subject.model, Sampling()))
    viewing.wait_until_idle(session)
    session.change(section=section)
    random = np.random.default_rng(5)
    agreed = found = 0
    with off_screen(400, 300) as (plotter, _):
        scene = Scene(plotter)
        scene.update(session)
        width, height = plotter.window_size
        for _ in range(300):
            x, y = random.uniform(0.0, width), random.uniform(0.0, height)
            near, far = (seen_at(plotter, x, y, depth) for depth in (0.0, 1.0))
            expected = hit_vertex(subject, near, far - near, section)
            agreed += scene.pick(x, y) == expected
            found += expected is not None
    session.close()
    assert found > 30
    assert agreed >= 297  # rays along an edge may hit either face


def seen_at(plotter: pyvista.Plotter, x: float, y: float, depth: float) -> NDArray[np.float64]:
    """Point at a position of the window, and a depth from 0 to 1."""
    renderer = plotter.renderers[0]
    renderer.SetDisplayPoint(x, y, depth)
    renderer.DisplayToWorld()
    point = np.array(renderer.GetWorldPoint())
    return np.asarray(point[:3] / point[3])


@needs_opengl
def test_nothing_is_left_of_what_was_drawn_before() -> None:
    name = "a$b$\nc"
    labels = scanned(subdivisions=1)
    subject = subject_of(labels, name)
    collection = Collection((Item(name, lambda: subject),), labels.model, Sampling())
    with viewed(collection, legend=True) as (session, scene):
        first, props = scene.screenshot(), scene.plotter.renderers[0].GetViewProps()
        count = props.GetNumberOfItems()
        for paint in ("critical_angle", "margin", "label") * 3:
            drawn = after(
                session, scene, paint=paint, friction=0.5 * session.model.nominal_friction
            )
            assert not np.array_equal(drawn, first)
        last = after(session, scene, friction=1.0)
        assert props.GetNumberOfItems() == count
        assert np.array_equal(first, last)
