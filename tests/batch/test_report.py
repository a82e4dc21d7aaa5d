import base64
import gzip
import hashlib
import io
import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from grasp3d import (
    GraspModel,
    Label,
    MeshOptions,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
    mesh_from_arrays,
)
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report import object_script, thumbnail, write_report
from grasp3d.batch.report.library import COLUMNS, library_data
from grasp3d.batch.report.thumbnails import HEIGHT, WIDTH
from grasp3d.batch.report.views import ELEVATIONS
from grasp3d.batch.report.words import settings_in_words
from grasp3d.batch.row import Outcome, Row, Share
from grasp3d.mesh.primitives import box_mesh, sphere_mesh
from grasp3d.settings import DEGREE
from grasp3d.stability.label import COLORS
from grasp3d.stability.thresholds import label_angles
from tests.helpers.reports import Local, best_of, row_of
from tests.helpers.shapes import LIBRARY

WEB = Path(__file__).parents[2] / "web"
STATIC = Path(__file__).parents[2] / "grasp3d" / "batch" / "report" / "static"
KINDS = {"u1": "<u1", "u2": "<u2", "u4": "<u4", "f4": "<f4"}
EVIL = (
    "a/</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    "<!--SCRIPT-->\u202e&amp;'\".ply"
)
MODEL = GraspModel(friction=0.3, sensor_resolution=20.0 * DEGREE)
COARSE = Sampling(rays=8, search_angle=60.0 * DEGREE)


@pytest.fixture(scope="module")
def spray() -> SurfaceLabels:
    mesh = load_mesh(LIBRARY / "spray.glb")
    return label_surface(mesh, MODEL, sampling=COARSE, threads=1)


@pytest.fixture(scope="module")
def box() -> SurfaceLabels:
    mesh = box_mesh((0.1, 0.2, 0.3), max_edge=0.05)
    return label_surface(mesh, MODEL, sampling=COARSE, threads=1)


def decoded(script: bytes) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """What the page reads from a script."""
    found = re.fullmatch(
        r'grasp3dObject\((\{.*\}),"([A-Za-z0-9+/=]*)"\);\n', script.decode("ascii")
    )
    assert found
    told = json.loads(found[1])
    data = gzip.decompress(base64.b64decode(found[2]))
    arrays, start = {}, 0
    for name, kind, count in told["arrays"]:
        arrays[name] = np.frombuffer(data, KINDS[kind], count, start)
        start += arrays[name].nbytes
    assert start == len(data)
    return told, arrays


def painted(mesh: ObjectMesh, stable: NDArray[np.bool_]) -> SurfaceLabels:
    """Labels S and U wherever they are wanted."""
    labels = label_surface(mesh, MODEL, sampling=Sampling(rays=8), threads=1)
    angles = np.where(stable, 0.0, np.inf)
    return replace(labels, critical_angle=angles, critical_angle_best=angles)


def pixels(picture: bytes) -> dict[Label | None, NDArray[np.bool_]]:
    """Where each colour shows, by hue; None: anything at all."""
    image = np.asarray(Image.open(io.BytesIO(picture)).convert("RGBA"), dtype=float)
    shown = image[..., 3] > 128.0
    hues = image[..., :3] / np.maximum(np.linalg.norm(image[..., :3], axis=2, keepdims=True), 1.0)
    palette = np.array([COLORS[label] for label in sorted(Label)], dtype=float)
    palette /= np.linalg.norm(palette, axis=1, keepdims=True)
    nearest = np.linalg.norm(hues[:, :, None] - palette, axis=3).argmin(axis=2)
    return {None: shown, **{label: shown & (nearest == label) for label in Label}}


@pytest.mark.parametrize("name", ["spray", "box"])
def test_script_holds_the_surface_and_its_numbers(
    name: str, request: pytest.FixtureRequest
) -> None:
    labels: SurfaceLabels = request.getfixturevalue(name)
    mesh = labels.mesh
    told, arrays = decoded(object_script(labels, "a mesh", best_of(labels)))
    used = np.unique(mesh.faces)
    numbers = arrays.get("numbers", np.arange(len(mesh.vertices)))
    assert np.array_equal(numbers, used)
    places = told["low"] + np.array(told["step"]) * arrays["positions"].reshape(-1, 3)
    assert np.abs(places - mesh.vertices[used]).max() < 1e-4 * mesh.size
    assert np.array_equal(numbers[arrays["faces"].reshape(-1, 3)], mesh.faces)
    assert np.array_equal(arrays["worst"], labels.critical_angle[used].astype(np.float32))
    best = arrays.get("best", arrays["worst"])
    assert np.array_equal(best, labels.critical_angle_best[used].astype(np.float32))
    assert np.array_equal(arrays["epsilon"], labels.epsilon[used].astype("<f4"), equal_nan=True)
    assert np.array_equal(arrays["opening"], labels.opening[used].astype("<f4"), equal_nan=True)
    held = np.isfinite(labels.partners[used]).all(axis=(1, 2))
    assert np.array_equal(np.isfinite(arrays["opening"]), held)
    partners = told["low"] + np.array(told["step"]) * arrays["partners"].reshape(-1, 1, 3)
    assert np.abs(partners - labels.partners[used])[held].max() < 1e-4 * mesh.size
    assert np.array_equal(arrays["reason"], labels.reason[used])
    areas = mesh.vertex_areas / mesh.vertex_areas.sum()
    assert np.allclose(arrays["weights"], areas[used], rtol=1e-6, atol=0.0)
    assert told["name"] == "a mesh"
    assert told["unit"] == mesh.unit
    assert told["size"] == mesh.size
    assert (told["friction"], told["resolution"]) == (0.3, 20.0 * DEGREE)
    assert told["cone"] == labels.search.cone
    assert told["grasps"][0]["points"] == [list(point) for point in best_of(labels)[0].points]


def test_creases_have_two_angles_and_smooth_surfaces_one(box: SurfaceLabels) -> None:
    assert "best" in decoded(object_script(box, "box", ()))[1]
    ball = label_surface(sphere_mesh(subdivisions=2), MODEL, sampling=COARSE, threads=1)
    assert "best" not in decoded(object_script(ball, "ball", ()))[1]


@pytest.mark.parametrize(("friction", "degrees"), [(0.3, 20.0), (0.1, 1.0), (0.7, 30.0)])
def test_labels_in_the_page_are_those_of_relabel(
    spray: SurfaceLabels, friction: float, degrees: float
) -> None:
    """Angles in the page may differ by rounding only, far below 0.01 degree."""
    asked = spray.relabel(friction=friction, sensor_resolution=degrees * DEGREE)
    _, arrays = decoded(object_script(spray, "spray", ()))
    worst = arrays["worst"].astype(float)
    best = arrays.get("best", arrays["worst"]).astype(float)
    there = label_angles(worst, best, asked.model)
    beta, tilt = asked.model.friction_angle, asked.model.tilt
    near = np.minimum(np.abs(worst - (beta - tilt)), np.abs(best - (beta + tilt)))
    assert (near < 0.01 * DEGREE).mean() < 0.05
    differs = there != asked.label[np.unique(spray.mesh.faces)]
    assert not differs[near > 1e-6].any()


def test_vertices_of_no_face_are_left_out_and_the_others_keep_their_numbers() -> None:
    ball = sphere_mesh(subdivisions=2)
    vertices = np.concatenate([[[9.0, 9.0, 9.0]], ball.vertices])
    mesh = mesh_from_arrays(vertices, ball.faces + 1, max_edge=10.0)
    labels = label_surface(mesh, MODEL, sampling=COARSE, threads=1)
    told, arrays = decoded(object_script(labels, "ball", ()))
    assert arrays["numbers"].tolist() == list(range(1, len(vertices)))
    assert np.allclose(told["low"], ball.vertices.min(axis=0))


def test_narrow_cone_counts_as_far_as_the_model_asks(box: SurfaceLabels) -> None:
    """A search that was limited on purpose answers for its own model, as in relabel."""
    limited = replace(box, search=replace(box.search, cone=0.1))
    limited.relabel()
    told, _ = decoded(object_script(limited, "box", ()))
    assert told["cone"] == pytest.approx(math.atan(0.3) + 10.0 * DEGREE)


def test_script_holds_no_markup_whatever_the_name_is(box: SurfaceLabels) -> None:
    script = object_script(box, EVIL, ())
    assert not set(b"<>&") & set(script)
    assert b"\\u202e" in script
    assert decoded(script)[0]["name"].startswith("a/</script><script>")


def test_same_labels_make_the_same_bytes(box: SurfaceLabels) -> None:
    assert object_script(box, "box", ()) == object_script(box, "box", ())
    assert thumbnail(box) == thumbnail(box)


def test_thumbnail_is_a_small_picture_on_transparent_ground(spray: SurfaceLabels) -> None:
    picture = thumbnail(spray)
    image = Image.open(io.BytesIO(picture))
    assert (image.format, image.size) == ("WEBP", (WIDTH, HEIGHT))
    assert len(picture) < 8000
    shown = pixels(picture)
    rows, columns = np.nonzero(shown[None])
    assert rows.min() > 0
    assert rows.max() < HEIGHT - 1
    assert max(np.ptp(rows) / HEIGHT, np.ptp(columns) / WIDTH) > 0.9
    for label in Label:
        assert shown[label].sum() > 0.01 * shown[None].sum(), label.name


def test_thumbnail_shows_each_label_in_its_visible_share() -> None:
    """Of a ball whose upper half is S an eye at elevation e sees (1 + sin e) / 2 as S."""
    ball = sphere_mesh(subdivisions=4)
    shown = pixels(thumbnail(painted(ball, ball.vertices[:, 2] > 0.0)))
    share = shown[Label.S].sum() / shown[None].sum()
    expected = [(1.0 + math.sin(elevation)) / 2.0 for elevation, _ in ELEVATIONS]
    assert min(abs(share - one) for one in expected) < 0.025
    assert shown[Label.M].sum() < 0.025 * shown[None].sum()  # where S and U are mixed
    upper, lower = (np.nonzero(shown[label])[0].mean() for label in (Label.S, Label.U))
    assert upper < lower  # rows are counted from above


def test_thumbnail_turns_to_where_the_labels_differ() -> None:
    ball = sphere_mesh(subdivisions=3)
    axis = ball.vertices @ [math.cos(0.3), math.sin(0.3), 0.0]
    shown = pixels(thumbnail(painted(ball, axis > 0.8)))
    assert shown[Label.S].sum() > 0.02 * shown[None].sum()


@pytest.mark.parametrize(
    "extents", [(1.0, 0.001, 0.001), (0.001, 0.001, 1.0), (1.0, 1.0, 0.001), (1.0, 0.001, 1.0)]
)
def test_thumbnail_shows_needles_and_plates(extents: tuple[float, float, float]) -> None:
    labels = painted(mesh := box_mesh(extents, max_edge=0.2), np.ones(len(mesh.vertices), bool))
    shown = pixels(thumbnail(labels))[None]
    rows, columns = np.nonzero(shown)
    assert max(np.ptp(rows) / HEIGHT, np.ptp(columns) / WIDTH) > 0.85
    assert shown.sum() > 150


def test_thumbnail_shows_open_surfaces_from_behind() -> None:
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    mesh = mesh_from_arrays(square, np.array([[0, 2, 1], [0, 3, 2]]), max_edge=0.3)
    assert not mesh.report.closed
    assert pixels(thumbnail(painted(mesh, np.ones(len(mesh.vertices), bool))))[None].sum() > 2000


def test_rows_and_numbers_of_the_page(box: SurfaceLabels) -> None:
    row = row_of(box, "tools/box.ply", "tools/box")
    lost = Row("lost.ply", outcome=Outcome.LOST, error="lost.ply: too slow")
    without = replace(row, critical_angle_p50=math.inf, view="", thumbnail="")
    data = library_data([row, lost, without], BatchSettings(MODEL))
    first, second, third = (dict(zip(COLUMNS, one, strict=True)) for one in data["rows"])
    assert first["stem"] == "tools/box"
    assert first["thumbnail"] == "thumbnails/tools/box.webp"
    assert first["stable"] == pytest.approx(box.fractions()["S"], rel=1e-5)
    assert row.required_resolution_80 is not None
    assert first["resolution80"] == pytest.approx(math.degrees(row.required_resolution_80))
    assert (second["outcome"], second["error"]) == ("lost", "lost.ply: too slow")
    assert second["stem"] == second["thumbnail"] == ""
    assert second["stable"] is None
    assert third["angle"] == math.inf
    assert third["stem"] == ""


def test_curves_are_quartiles_over_the_meshes_that_tell() -> None:
    rows = [
        Row(
            f"{k}.ply",
            shares=(
                Share(0.5, 0.0, 0.1 * k, 1.0 - 0.1 * k, 0.0),
                Share(0.5, 0.5, 0.05 * k, None if k else 0.4, None if k else 0.6),
                Share(0.5, 1.0, 0.0, None, None),
            ),
        )
        for k in range(5)
    ]
    [curve] = library_data(rows, BatchSettings())["curves"]
    assert curve["friction"] == 0.5
    assert curve["meshes"] == [5, 5, 5]
    assert curve["told"] == [5, 1, 0]
    assert np.allclose(curve["S"], [[0.1, 0.2, 0.3], [0.05, 0.1, 0.15], [0.0, 0.0, 0.0]])
    assert np.allclose(curve["U"][1], 0.6)
    assert curve["M"][2] is curve["U"][2] is None


def test_settings_in_words() -> None:
    said = dict(settings_in_words(BatchSettings()))
    assert said["Friction"] == "μ 0.5 (cone of β 26.57°)"
    assert said["Sensor resolution"] == "α 22.6°"
    assert said["Grip"] == "squeeze"
    assert said["Labels"].endswith("exact")
    assert "Opening" not in said
    limited = BatchSettings(
        GraspModel(method="extremes", edges=8, actuation="per_finger", torsion_radius=0.01),
        Sampling(min_opening=0.01, max_opening=0.08, grip="both", search_angle=1.0),
        MeshOptions(patch_radius=0.002, max_edge=0.01, unit="m"),
    )
    said = dict(settings_in_words(limited))
    assert said["Opening"] == "at least 0.01 and at most 0.08 (in each mesh's unit)"
    assert said["Grip"] == "squeeze or expand"
    assert said["Labels"] == "from wrench hulls at 8 extreme normals, sampled"
    assert said["Epsilon"] == "cones of 8 edges, each finger's force at most 1"
    assert said["Fingers"] == "2, soft"
    assert {"Torsion radius", "Patch radius", "Longest edge", "Unit of the files"} <= set(said)
    assert said["Searched"] == "grasps with β* up to 57.3°"
    hand = BatchSettings(GraspModel(fingers=3), Sampling(max_spread=0.12))
    said = dict(settings_in_words(hand))
    assert said["Distances of contacts"] == "at most 0.12 (in each mesh's unit)"
    assert "Grip" not in said


def test_report_is_a_folder_of_four_files(tmp_path: Path, box: SurfaceLabels) -> None:
    write_report(Local(tmp_path), [row_of(box, "box.ply", "box")], BatchSettings(MODEL))
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert names == {"index.html", "object.html", "viewer.js", "viewer.css"}
    page = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert "<!--STYLE-->" not in page
    assert not re.search(r'(src|href)="(https?:)?//', page)


def test_names_and_errors_of_meshes_are_no_markup(tmp_path: Path, box: SurfaceLabels) -> None:
    row = row_of(box, EVIL, "box")
    rows = [
        row,
        Row(EVIL, outcome=Outcome.REFUSED, error=EVIL),
        Row("a\udcff.ply", error="\x1b[0m"),
    ]
    write_report(Local(tmp_path), rows, BatchSettings(MODEL))
    for name, place in (("index.html", "data"), ("object.html", "library")):
        page = (tmp_path / "report" / name).read_text(encoding="utf-8")
        start = page.index(f'<script type="application/json" id="{place}">')
        text = page[page.index(">", start) + 1 : page.index("</script>", start)]
        assert "alert(1)" in text
        assert not set("<>&") & set(text)
        json.loads(text)
        assert page.count("alert(1)") == text.count("alert(1)")
    data = json.loads(text)
    assert data == [["box", EVIL.replace("\u202e", "\\u202e")]]


@pytest.mark.parametrize("rows", [[], [Row("a.ply", outcome=Outcome.LOST, error="gone")]])
def test_report_of_nothing_labelled_is_written(tmp_path: Path, rows: list[Row]) -> None:
    write_report(Local(tmp_path), rows, BatchSettings())
    assert "gone" in (tmp_path / "report" / "index.html").read_text("utf-8") or not rows


def test_bundles_are_made_of_these_sources() -> None:
    """A stale bundle fails here: build it anew in web/ with npm ci && npm run build."""
    names = [
        path.relative_to(WEB).as_posix() for path in (WEB / "src").rglob("*") if path.is_file()
    ]
    digest = hashlib.sha256()
    for name in sorted([*names, "build.mjs", "package.json", "package-lock.json"]):
        text = (WEB / name).read_text(encoding="utf-8")
        digest.update(f"{name}\0{text}\0".encode())
    for path in STATIC.iterdir():
        assert digest.hexdigest() in path.read_text(encoding="utf-8")[:400], path.name


def test_bundles_hold_the_licences_of_what_they_are_made_of() -> None:
    for name, packages in (("viewer.js", ["three"]), ("library.js", ["tabulator-tables", "uplot"])):
        text = (STATIC / name).read_text(encoding="utf-8")
        versions = json.loads((WEB / "package.json").read_text(encoding="utf-8"))["devDependencies"]
        for package in packages:
            assert f"{package} {versions[package]}\n" in text[:8000]
        assert text[:8000].count("Permission is hereby granted") == len(packages)


def test_lock_file_names_no_registry() -> None:
    assert "resolved" not in (WEB / "package-lock.json").read_text(encoding="utf-8")


@pytest.mark.slow
def test_building_anew_gives_the_same_bundles(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None or not (WEB / "node_modules").is_dir():
        pytest.skip("needs node, and web/node_modules from npm ci")
    subprocess.run([node, "build.mjs", str(tmp_path)], cwd=WEB, check=True, capture_output=True)
    for path in STATIC.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name
