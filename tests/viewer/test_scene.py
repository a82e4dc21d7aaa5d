import math
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import pyvista
from hypothesis import given
from hypothesis import strategies as st
from numpy.typing import NDArray
from PIL import Image

from grasp3d import GraspModel, Sampling, SurfaceLabels, scan_surface
from grasp3d.errors import GraspError, MeshError, OutputError
from grasp3d.mesh import load_mesh
from grasp3d.pictures import opengl
from grasp3d.pictures.camera import axes_of
from grasp3d.pictures.captions import ACROSS, DOWN, MAX_SIZE, MIN_SIZE, round_length
from grasp3d.pictures.opengl import choose_window, new_plotter, off_screen
from grasp3d.pictures.subject import Subject, subject_of
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.system.context import running
from grasp3d.viewer.collection import Collection, Item, Section, collection_of
from grasp3d.viewer.scene import Scene, captions_of
from grasp3d.viewer.screenshots import open_renderer, save_picture
from grasp3d.viewer.session import Session
from tests.helpers import oracles, viewing
from tests.helpers.solids import box_mesh, cylinder_mesh
from tests.helpers.viewing import shown, wait_until_idle
from tests.pictures.test_opengl import needs_opengl

Pixels = NDArray[np.uint8]
Floats = NDArray[np.float64]

WIDE, HIGH = 400, 320


@cache
def held_box() -> SurfaceLabels:
    model = GraspModel(friction=1.0, sensor_resolution=math.radians(15.0))
    return scan_surface(box_mesh((1.0, 2.0, 3.0), max_edge=0.5), model, fixed=(0.0, 0.0, -1.5))


@contextmanager
def viewed(
    collection: Collection, *, legend: bool = False, width: int = WIDE, height: int = HIGH,
    **how: object,
) -> Iterator[tuple[Session, Scene]]:  # fmt: skip
    choose_window()
    how = {"azimuth": 0.0, "elevation": 0.0} | how
    session = Session(collection, ViewSettings(width=width, height=height, **how))
    wait_until_idle(session)
    plotter = new_plotter(width, height)
    try:
        scene = Scene(plotter, legend=legend)
        scene.update(session)
        yield session, scene
    finally:
        session.close()
        plotter.close()


def after(session: Session, scene: Scene, **choices: object) -> Pixels:
    session.change(**choices)
    wait_until_idle(session)
    scene.update(session)
    return scene.screenshot()


def coloured(image: Pixels) -> NDArray[np.bool_]:
    """Pixels that are not grey: the coloured surface."""
    return np.asarray(np.ptp(image.astype(int), axis=2) > 40)


def pixel_of(scene: Scene, point: Floats) -> tuple[int, int]:
    """Row and column of the pixel that shows a point."""
    renderer = scene.plotter.renderers[0]
    renderer.SetWorldPoint(*point, 1.0)
    renderer.WorldToDisplay()
    x, y, _ = renderer.GetDisplayPoint()
    return round(scene.plotter.window_size[1] - 1 - y), round(x)


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


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize(("width", "height"), [(320, 240), (640, 400), (500, 700)])
def test_the_object_fills_its_pane_without_overlapping_texts(width: int, height: int) -> None:
    how = {"width": width, "height": height, "elevation": 0.4, "azimuth": 1.0}
    with viewed(collection_of(held_box()), legend=True, **how) as (session, scene):
        image = scene.screenshot()
        points = shown(session).mesh.vertices
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


def test_settings_contain_the_largest_opening_if_it_is_limited() -> None:
    text = "α 22.6°   μ 0.75   two fingers   opening ≤ 3 mm"
    for labels, settings in (
        (viewing.labels(), text),
        (viewing.box(), "α 22.6°   μ 0.5   two fingers"),
    ):
        found = captions_of(viewing.ready_session(labels), None, legend=True)
        assert found.settings == settings


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
    """The expected vertex, from tests of all faces."""
    mesh = subject.mesh
    hits = oracles.crossings(origin, way, mesh.vertices, mesh.faces)
    if section is not None:
        point, normal = section.plane(subject.bounds)
        hits = [(face, t) for face, t in hits if (origin + t * way - point) @ normal >= 0.0]
    if not hits:
        return None
    (face, t), *_ = hits
    gaps = np.linalg.norm(mesh.vertices[mesh.faces[face]] - (origin + t * way), axis=1)
    return int(mesh.faces[face, np.argmin(gaps)])


@cache
def cut_cylinder(offset: float) -> Subject:
    mesh = cylinder_mesh(0.5, 2.0, max_edge=0.5)
    moved = load_mesh((mesh.vertices + offset, mesh.faces), max_edge=1.0)
    return subject_of(scan_surface(moved, fixed=(offset, offset, offset - 1.0)))


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize(
    ("section", "offset"), [(None, 0.0), (Section("y", 0.37, flipped=True), 1e4)]
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


SMALL = ViewSettings(width=320, height=240)


@needs_opengl
def test_a_picture_has_its_size_and_smooth_edges(tmp_path: Path) -> None:
    path, reported = tmp_path / "box.png", list[float]()
    with running(progress=reported.append):
        save_picture(collection_of(held_box()), ViewSettings(width=501, height=301), path)
    with Image.open(path) as picture:
        drawn = np.asarray(picture.convert("RGB"))
    assert drawn.shape == (301, 501, 3)
    assert reported == sorted(reported)
    assert reported[-1] == 1.0
    colours = np.unique(drawn.reshape(-1, 3), axis=0)
    assert len(colours) > 200  # edges have mixtures of both colours
    assert [one.name for one in tmp_path.iterdir()] == ["box.png"]


def test_without_opengl_the_old_file_is_kept(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "can_render", lambda: False)
    path = tmp_path / "box.png"
    path.write_bytes(b"before")
    with pytest.raises(OutputError, match="need OpenGL"):
        save_picture(collection_of(held_box()), SMALL, path)
    assert path.read_bytes() == b"before"


@needs_opengl
def test_the_error_of_an_object_is_raised(tmp_path: Path) -> None:
    def broken() -> Subject:
        raise MeshError("cup.stl: is not a mesh")

    collection = Collection((Item("cup.stl", broken),), GraspModel(), Sampling())
    with pytest.raises(GraspError, match=r"cup\.stl: is not a mesh"):
        save_picture(collection, SMALL, tmp_path / "cup.png")
    assert not list(tmp_path.iterdir())


@needs_opengl
def test_very_large_pictures_are_not_oversampled(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(opengl, "MAX_DRAWN", 500)
    with open_renderer(collection_of(held_box()), SMALL) as renderer:
        assert renderer.oversampling == 1
        assert renderer.picture().shape == (240, 320, 3)
