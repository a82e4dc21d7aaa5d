import math
import os
import subprocess
import sys
from ctypes.util import find_library
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, scan_surface
from grasp3d.errors import OutputError, SettingError
from grasp3d.mesh.primitives import box_mesh, cylinder_mesh, sphere_mesh
from grasp3d.plots import rendering
from grasp3d.plots.painting import PALETTE, _cut, paint_labels
from grasp3d.plots.rendering import MARGIN, Finger, View, can_render, picture
from tests.helpers import shapes

Image = NDArray[np.uint8]

NO_LIBRARY = {rendering.WINDOW: "vtkOSOpenGLRenderWindow"}
FRONT = View(azimuth=0.0, elevation=0.0)
SIZE = 240

# In CI a missing OpenGL is a failure.
needs_opengl = pytest.mark.skipif(not (os.environ.get("CI") or can_render()), reason="needs OpenGL")


@pytest.fixture
def without_cache() -> object:
    """Clear the cached result of `can_render` before and after the test."""
    for cached in (can_render, rendering.begin_render_test):
        cached.cache_clear()
    yield None
    for cached in (can_render, rendering.begin_render_test):
        cached.cache_clear()


def fake_python(folder: Path, script: str) -> str:
    path = folder / "python"
    path.write_text(f"#!/bin/sh\n{script}\n")
    path.chmod(0o755)
    return str(path)


@pytest.mark.slow
@pytest.mark.skipif(sys.platform == "win32", reason="needs a shell script")
@pytest.mark.parametrize("script", ["kill -SEGV $$", "exit 1", "exec sleep 60"])
@pytest.mark.usefixtures("without_cache")
def test_a_process_that_dies_or_hangs_means_no_rendering(
    script: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(rendering, "TIMEOUT", 0.5)
    monkeypatch.setattr(sys, "executable", fake_python(tmp_path, script))
    assert not can_render()
    with pytest.raises(OutputError, match="need OpenGL"):
        picture(*shapes.box(), np.zeros((8, 3)))


@pytest.mark.usefixtures("without_cache")
def test_the_separate_process_finds_what_it_imports(monkeypatch: pytest.MonkeyPatch) -> None:
    codes: list[str] = []
    monkeypatch.setattr(rendering, "_started", codes.append)
    can_render()
    imports, _, _ = codes[0].partition(";")
    exec(imports)  # noqa: S102


@pytest.mark.slow
@pytest.mark.skipif(
    sys.platform != "linux" or find_library("OSMesa") is not None, reason="OSMesa draws"
)
def test_a_missing_library_is_detected_in_a_separate_process() -> None:
    code = (
        f"import os; os.environ.update({NO_LIBRARY}); os.environ.pop('DISPLAY', None)\n"
        "from grasp3d.plots.rendering import can_render; print(can_render(), can_render())"
    )
    run = subprocess.run(
        [sys.executable, "-c", code], check=True, capture_output=True, text=True, timeout=120
    )
    assert (run.stdout, run.stderr) == ("False False\n", "")


@given(st.floats(-10.0, 10.0), st.floats(-1.6, 1.6))
def test_a_view_has_right_handed_axes_with_up_above(azimuth: float, elevation: float) -> None:
    axes = View(azimuth, elevation).axes
    assert axes @ axes.T == pytest.approx(np.eye(3), abs=1e-12)
    assert np.cross(axes[0], axes[1]) == pytest.approx(axes[2], abs=1e-12)
    assert axes[2, 2] == pytest.approx(math.sin(elevation))
    assert axes[0, 2] == 0.0


def test_colours_and_normals_are_one_per_vertex() -> None:
    vertices, faces = shapes.box()
    with pytest.raises(SettingError, match=r"colors .* \(8, 3\); got \(7, 3\)"):
        picture(vertices, faces, np.zeros((7, 3)))
    with pytest.raises(SettingError, match=r"normals .* got \(8,\)"):
        picture(vertices, faces, np.zeros((8, 3)), normals=np.zeros(8))


def seen(image: Image) -> NDArray[np.bool_]:
    return np.asarray((image < 250).any(axis=2))


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize("size", [(SIZE, SIZE), (300, 150), (120, 260)])
def test_a_picture_is_filled_by_the_whole_surface(size: tuple[int, int]) -> None:
    vertices, faces = shapes.box((1.0, 2.0, 0.5))
    image = picture(
        vertices + (40.0, -7.0, 3.0), faces, np.full((8, 3), 99), view=FRONT, size=size
    )  # fmt: skip
    assert image.shape == (size[1], size[0], 3)
    assert image.dtype == np.uint8
    rows, columns = np.nonzero(seen(image))
    width, height = np.ptp(columns) + 1, np.ptp(rows) + 1
    scale = min(size[0] / 2.0, size[1] / 0.5) / MARGIN  # pixels per unit
    assert (width, height) == pytest.approx((2.0 * scale, 0.5 * scale), abs=2.0)
    middle = (columns.min() + columns.max()) / 2.0, (rows.min() + rows.max()) / 2.0
    assert middle == pytest.approx(((size[0] - 1) / 2.0, (size[1] - 1) / 2.0), abs=1.5)


@pytest.mark.slow
@needs_opengl
def test_right_and_up_of_pictures() -> None:
    vertices, faces = shapes.sphere(3)
    red_right = np.where(vertices[:, 1:2] > 0.0, (255, 0, 0), (0, 0, 255))
    image = picture(vertices, faces, red_right, view=FRONT, size=(SIZE, SIZE))
    assert image[SIZE // 2, SIZE * 3 // 4].argmax() == 0
    assert image[SIZE // 2, SIZE // 4].argmax() == 2
    red_above = np.where(vertices[:, 2:] > 0.0, (255, 0, 0), (0, 0, 255))
    image = picture(vertices, faces, red_above, view=FRONT, size=(SIZE, SIZE))
    assert image[SIZE // 4, SIZE // 2].argmax() == 0
    assert image[SIZE * 3 // 4, SIZE // 2].argmax() == 2


@needs_opengl
def test_light_changes_only_the_brightness_up_to_the_exact_colour() -> None:
    vertices, faces = shapes.sphere(4)
    color = np.array([240, 120, 60])
    image = picture(vertices, faces, np.tile(color, (len(vertices), 1)), size=(SIZE, SIZE))
    edge = seen(image) & ~np.pad(seen(image), 2)[4:, 2:-2] & ~seen(image)
    inside = image[seen(image) & ~edge].astype(float)
    kept = inside[np.abs(inside[:, 0] - 2.0 * inside[:, 1]) < 3.0]
    assert len(kept) > 0.97 * len(inside)  # except rim pixels blended with the background
    assert kept.max(axis=0) == pytest.approx(color, abs=3.0)
    assert kept[:, 0].min() > 0.4 * color[0]


@pytest.mark.slow
@needs_opengl
def test_the_same_picture_every_time() -> None:
    scanned = scan_surface(box_mesh(max_edge=0.5), GraspModel(friction=1.0), fixed=(0, 0, -1))
    finger = Finger(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]))
    first, second = (
        paint_labels(scanned, size=(SIZE, SIZE), fingers=[finger]) for _ in range(2)
    )  # fmt: skip
    assert (first == second).all()


@pytest.mark.slow
@needs_opengl
def test_a_finger_is_visible_and_its_hidden_parts_are_transparent() -> None:
    vertices, faces = shapes.box((2.0, 2.0, 2.0))
    white = np.full((8, 3), 255)
    behind = Finger(np.array([-1.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0]))
    below = Finger(np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]))
    plain = picture(vertices, faces, white, view=FRONT, size=(SIZE, SIZE))
    hidden = picture(vertices, faces, white, view=FRONT, size=(SIZE, SIZE), fingers=[behind])
    shown = picture(vertices, faces, white, view=FRONT, size=(SIZE, SIZE), fingers=[below])
    middle = SIZE // 2, SIZE // 2
    assert 0.3 * plain[middle].min() < hidden[middle].max() < 0.7 * plain[middle].min()
    rows, columns = np.nonzero(shown.max(axis=2) < 60)
    assert len(rows) > 50
    assert columns.mean() == pytest.approx((SIZE - 1) / 2.0, abs=1.0)
    assert rows.min() > SIZE / 2.0  # below the box, pointing up


def nearest_label(pixels: NDArray[np.float64]) -> NDArray[np.int64]:
    """Label with the hue of each shaded pixel."""
    hues = PALETTE / np.linalg.norm(PALETTE, axis=1, keepdims=True)
    shades = pixels / np.linalg.norm(pixels, axis=1, keepdims=True)
    return np.asarray((shades @ hues.T).argmax(axis=1))


@pytest.mark.slow
@needs_opengl
@pytest.mark.parametrize(("degrees", "location"), [(15.0, 0.0), (30.0, 0.0), (15.0, 0.06)])
def test_every_pixel_of_a_labelled_sphere_agrees_with_the_closed_form(
    degrees: float, location: float
) -> None:
    model = GraspModel(
        friction=1.0, sensor_resolution=math.radians(degrees), location_error=location
    )
    scanned = scan_surface(sphere_mesh(subdivisions=4), model, fixed=(0.0, 0.0, -1.0))
    image = paint_labels(scanned, view=FRONT, size=(SIZE, SIZE)).astype(float)
    pixel = (np.arange(SIZE) + 0.5 - SIZE / 2.0) * (2.0 * MARGIN / SIZE)
    y, z = np.meshgrid(pixel, -pixel)
    inside = np.hypot(y, z) < 0.98
    critical = np.arccos(np.clip(z, -1.0, 1.0)) / 2.0  # half the angle from the opposite pole
    turn = np.arcsin(np.minimum(location / np.cos(critical), 1.0))  # contacts 2 cos apart
    expected = np.full(z.shape, int(Label.M))
    expected[critical + turn < model.friction_angle - model.tilt] = Label.S
    # The line is the bisector of both normals: none within its turn is better.
    expected[critical >= model.friction_angle + model.tilt] = Label.U
    found = nearest_label(image[inside])
    assert (found == expected[inside]).mean() > 0.985
    near = np.abs(critical + turn - model.friction_angle + model.tilt) < 0.02
    near |= np.abs(critical - model.friction_angle - model.tilt) < 0.02
    assert (found == expected[inside])[~near[inside]].all()


@needs_opengl
def test_a_face_is_coloured_up_to_its_creases_in_a_scan() -> None:
    model = GraspModel(friction=1.0, sensor_resolution=math.radians(15.0))
    scanned = scan_surface(box_mesh(max_edge=0.25), model, fixed=(0.0, 0.0, -1.0))
    image = paint_labels(
        scanned, view=View(azimuth=0.0, elevation=math.pi / 2.0), size=(SIZE, SIZE)
    )
    full = image[image.min(axis=2) < 80].astype(float)  # not blended with the background
    assert (nearest_label(full) == Label.S).mean() > 0.999
    assert set(scanned.label[np.abs(scanned.mesh.vertices[:, :2]).max(axis=1) > 0.999]) != {Label.S}


@needs_opengl
def test_labels_from_hulls_are_coloured_at_their_vertices() -> None:
    model = GraspModel(friction=1.0, sensor_resolution=math.radians(30.0), method="extremes")
    labels = scan_surface(sphere_mesh(subdivisions=3), model, fixed=(0.0, 0.0, -1.0))
    image = paint_labels(labels, view=FRONT, size=(SIZE, SIZE))
    x, y, z = labels.mesh.vertices.T
    facing = x > 0.4
    columns, rows = (
        np.floor((along * SIZE / (2.0 * MARGIN)) + SIZE / 2.0).astype(int) for along in (y, -z)
    )
    found = nearest_label(image[rows[facing], columns[facing]].astype(float))
    assert (found == labels.label[facing]).all()
    assert set(found) == set(Label)


triangles = hnp.arrays(np.float64, (5, 3, 3), elements=st.floats(-1.0, 1.0))


def areas(corners: NDArray[np.float64]) -> NDArray[np.float64]:
    a, b, c = (corners[:, i, :2] for i in range(3))
    ab, ac = b - a, c - a
    return 0.5 * (ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])


@given(triangles, st.floats(-1.0, 1.0))
def test_cutting_keeps_the_area_and_separates_the_sides(
    corners: NDArray[np.float64], limit: float
) -> None:
    below, above = _cut(corners, 2, limit)
    # Signed areas: no part is flipped.
    assert areas(below).sum() + areas(above).sum() == pytest.approx(areas(corners).sum(), abs=1e-9)
    assert (below[..., 2] <= limit + 1e-12).all()
    assert (above[..., 2] >= limit - 1e-12).all()


@pytest.mark.slow
def test_solids_are_closed_and_have_their_size() -> None:
    for mesh, volume, edge in (
        (sphere_mesh(2.0, subdivisions=4), 4.0 / 3.0 * math.pi * 8.0, math.inf),
        (box_mesh((1.0, 2.0, 3.0), max_edge=0.5), 6.0, 0.5),
        (cylinder_mesh(0.5, 2.0, max_edge=0.1), math.pi * 0.25 * 2.0, 0.1),
    ):
        assert mesh.report.closed
        assert mesh.volume == pytest.approx(volume, rel=0.01)
        assert mesh.center_mass == pytest.approx(np.zeros(3), abs=1e-9)
        assert not mesh.report.repairs
        corners = mesh.vertices[mesh.faces]
        lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2)
        assert lengths.max() <= edge * (1.0 + 1e-9)
    lying = cylinder_mesh(1.0, 3.0)
    assert np.ptp(lying.vertices, axis=0) == pytest.approx((3.0, 2.0, 2.0), rel=1e-3)
    assert len(lying.vertices) < 100_000
