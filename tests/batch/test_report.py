import base64
import hashlib
import io
import json
import math
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from PIL import Image

from grasp3d import (
    GraspModel,
    Label,
    MeshOptions,
    MultifingerSampling,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
)
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report import object_script, thumbnail, write_report
from grasp3d.batch.report.library import (
    COLUMNS,
    describe_settings,
    library_data,
    summarise_settings,
)
from grasp3d.batch.report.thumbnails import ELEVATIONS, HEIGHT, WIDTH
from grasp3d.batch.row import AreaFractions, Outcome, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.grasps.causes import cause_codes
from grasp3d.mesh.primitives import box_mesh, cylinder_mesh, sphere_mesh
from grasp3d.settings import DEGREE
from grasp3d.stability.label import COLORS
from grasp3d.stability.thresholds import label_angles
from tests.helpers.reports import best_of, decoded, row_of, with_critical_angles
from tests.helpers.shapes import LIBRARY

WEB = Path(__file__).parents[2] / "web"
STATIC = Path(__file__).parents[2] / "grasp3d" / "batch" / "report" / "static"
EVIL = (
    "a/</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    "<!--SCRIPT-->\u202e&amp;'\".ply"
)
MODEL = GraspModel(friction=0.3, sensor_resolution=20.0 * DEGREE)
COARSE = Sampling(rays=8, search_angle=60.0 * DEGREE)


@pytest.fixture(scope="module")
def spray() -> SurfaceLabels:
    mesh = load_mesh(LIBRARY / "spray.glb")
    return label_surface(mesh, MODEL, sampling=COARSE)


@pytest.fixture(scope="module")
def box() -> SurfaceLabels:
    mesh = box_mesh((0.1, 0.2, 0.3), max_edge=0.05)
    return label_surface(mesh, MODEL, sampling=COARSE)


def painted(mesh: ObjectMesh, stable: NDArray[np.bool_]) -> SurfaceLabels:
    """Labels with the given vertices S and the others U."""
    labels = label_surface(mesh, MODEL, sampling=Sampling(rays=8))
    angles = np.where(stable, 0.0, np.inf)
    return with_critical_angles(labels, angles)


def pixels(picture: bytes) -> dict[Label | None, NDArray[np.bool_]]:
    """Pixels of each label's colour, by hue; None: all pixels of the surface."""
    image = np.asarray(Image.open(io.BytesIO(picture)).convert("RGBA"), dtype=float)
    shown = image[..., 3] > 128.0
    hues = image[..., :3] / np.maximum(np.linalg.norm(image[..., :3], axis=2, keepdims=True), 1.0)
    palette = np.array([COLORS[label] for label in sorted(Label)], dtype=float)
    palette /= np.linalg.norm(palette, axis=1, keepdims=True)
    nearest = np.linalg.norm(hues[:, :, None] - palette, axis=3).argmin(axis=2)
    return {None: shown, **{label: shown & (nearest == label) for label in Label}}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["spray", "box"])
def test_script_contains_the_surface_and_its_values(
    name: str, request: pytest.FixtureRequest
) -> None:
    labels: SurfaceLabels = request.getfixturevalue(name)
    mesh = labels.mesh
    header, arrays = decoded(object_script(labels, "a mesh", best_of(labels)))
    used = np.unique(mesh.faces)
    numbers = arrays.get("numbers", np.arange(len(mesh.vertices)))
    assert np.array_equal(numbers, used)
    positions = header["low"] + np.array(header["step"]) * arrays["positions"].reshape(-1, 3)
    assert np.abs(positions - mesh.vertices[used]).max() < 1e-4 * mesh.size
    assert np.array_equal(numbers[arrays["faces"].reshape(-1, 3)], mesh.faces)
    assert np.array_equal(arrays["worst"], labels.critical_angle[used].astype(np.float32))
    best = arrays.get("best", arrays["worst"])
    assert np.array_equal(best, labels.critical_angle_best[used].astype(np.float32))
    assert np.array_equal(arrays["epsilon"], labels.epsilon[used].astype("<f4"), equal_nan=True)
    assert np.array_equal(arrays["opening"], labels.opening[used].astype("<f4"), equal_nan=True)
    has_grasp = np.isfinite(labels.partners[used]).all(axis=(1, 2))
    assert np.array_equal(np.isfinite(arrays["opening"]), has_grasp)
    partners = header["low"] + np.array(header["step"]) * arrays["partners"].reshape(-1, 1, 3)
    assert np.abs(partners - labels.partners[used])[has_grasp].max() < 1e-4 * mesh.size
    assert np.array_equal(arrays["cause"], cause_codes(labels)[used])
    areas = mesh.vertex_areas / mesh.vertex_areas.sum()
    assert np.allclose(arrays["weights"], areas[used], rtol=1e-6, atol=0.0)
    assert header["name"] == "a mesh"
    assert header["unit"] == mesh.unit
    assert header["size"] == mesh.size
    assert (header["friction"], header["resolution"]) == (0.3, 20.0 * DEGREE)
    assert header["cone"] == labels.search.cone
    assert header["grasps"][0]["points"] == [list(point) for point in best_of(labels)[0].points]


def test_sharp_edges_have_two_angles_and_smooth_surfaces_one(box: SurfaceLabels) -> None:
    assert "best" in decoded(object_script(box, "box", ()))[1]
    ball = label_surface(sphere_mesh(subdivisions=2), MODEL, sampling=COARSE)
    assert "best" not in decoded(object_script(ball, "ball", ()))[1]


@pytest.mark.parametrize(("friction", "degrees"), [(0.3, 20.0), (0.1, 1.0), (0.7, 30.0)])
def test_labels_in_the_page_are_those_of_relabel(
    spray: SurfaceLabels, friction: float, degrees: float
) -> None:
    """Angles in the page may differ by rounding only, far below 0.01 degree."""
    relabelled = spray.relabel(friction=friction, sensor_resolution=degrees * DEGREE)
    _, arrays = decoded(object_script(spray, "spray", ()))
    worst = arrays["worst"].astype(float)
    best = arrays.get("best", arrays["worst"]).astype(float)
    labels = label_angles(worst, best, relabelled.model)
    beta, tilt = relabelled.model.friction_angle, relabelled.model.tilt
    near = np.minimum(np.abs(worst - (beta - tilt)), np.abs(best - (beta + tilt)))
    assert (near < 0.01 * DEGREE).mean() < 0.05
    differs = labels != relabelled.label[np.unique(spray.mesh.faces)]
    assert not differs[near > 1e-6].any()


def test_vertices_without_faces_are_left_out_and_the_others_keep_their_numbers() -> None:
    ball = sphere_mesh(subdivisions=2)
    vertices = np.concatenate([[[9.0, 9.0, 9.0]], ball.vertices])
    mesh = load_mesh((vertices, ball.faces + 1), max_edge=10.0)
    labels = label_surface(mesh, MODEL, sampling=COARSE)
    header, arrays = decoded(object_script(labels, "ball", ()))
    assert arrays["numbers"].tolist() == list(range(1, len(vertices)))
    assert np.allclose(header["low"], ball.vertices.min(axis=0))


def test_a_narrow_cone_is_extended_to_the_model(box: SurfaceLabels) -> None:
    """A search that was limited on purpose is valid for its own model, as in relabel."""
    limited = replace(box, search=replace(box.search, cone=0.1))
    limited.relabel()
    header, _ = decoded(object_script(limited, "box", ()))
    assert header["cone"] == pytest.approx(math.atan(0.3) + 10.0 * DEGREE)


def test_script_contains_no_markup_for_any_name(box: SurfaceLabels) -> None:
    script = object_script(box, EVIL, ())
    assert not set(b"<>&") & set(script)
    assert b"\\u202e" in script
    assert decoded(script)[0]["name"].startswith("a/</script><script>")


def test_equal_labels_give_equal_bytes(box: SurfaceLabels) -> None:
    assert object_script(box, "box", ()) == object_script(box, "box", ())
    assert thumbnail(box) == thumbnail(box)


def test_thumbnail_is_a_small_picture_with_transparent_background(spray: SurfaceLabels) -> None:
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


def test_thumbnail_shows_the_visible_fraction_of_each_label() -> None:
    """For a ball whose upper half is S, (1 + sin e) / 2 is S in the view of elevation e."""
    ball = sphere_mesh(subdivisions=4)
    shown = pixels(thumbnail(painted(ball, ball.vertices[:, 2] > 0.0)))
    fraction = shown[Label.S].sum() / shown[None].sum()
    expected = [(1.0 + math.sin(elevation)) / 2.0 for elevation, _ in ELEVATIONS]
    assert min(abs(fraction - one) for one in expected) < 0.025
    assert shown[Label.M].sum() < 0.025 * shown[None].sum()  # where S and U are mixed
    upper, lower = (np.nonzero(shown[label])[0].mean() for label in (Label.S, Label.U))
    assert upper < lower  # rows are counted from above


def test_thumbnail_shows_the_side_on_which_the_labels_differ() -> None:
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
    mesh = load_mesh((square, np.array([[0, 2, 1], [0, 3, 2]])), max_edge=0.3)
    assert not mesh.report.closed
    assert pixels(thumbnail(painted(mesh, np.ones(len(mesh.vertices), bool))))[None].sum() > 2000


def test_rows_and_values_of_the_page(box: SurfaceLabels) -> None:
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


def test_curves_are_quartiles_over_the_meshes_with_values() -> None:
    rows = [
        Row(
            f"{k}.ply",
            fractions=(
                AreaFractions(0.5, 0.0, 0.1 * k, 1.0 - 0.1 * k, 0.0),
                AreaFractions(0.5, 0.5, 0.05 * k, None if k else 0.4, None if k else 0.6),
                AreaFractions(0.5, 1.0, 0.0, None, None),
            ),
        )
        for k in range(5)
    ]
    [curve] = library_data(rows, BatchSettings())["curves"]
    assert curve["friction"] == 0.5
    assert curve["meshes"] == [5, 5, 5]
    assert curve["searched"] == [5, 1, 0]
    assert np.allclose(curve["S"], [[0.1, 0.2, 0.3], [0.05, 0.1, 0.15], [0.0, 0.0, 0.0]])
    assert np.allclose(curve["U"][1], 0.6)
    assert curve["M"][2] is curve["U"][2] is None


def test_each_combination_of_errors_has_a_curve() -> None:
    """Locations are in millimetres, so that meshes in other units have the same curves."""
    rows = [
        Row(
            f"{unit}.ply",
            unit=unit,
            fractions=tuple(
                AreaFractions(0.5, alpha, 0.5, 0.5, 0.0, error, math.radians(2.0), location)
                for error in (0.0, 0.1)
                for location in (0.0, length)
                for alpha in (0.0, 0.2)
            ),
        )
        for unit, length in (("m", 0.001), ("mm", 1.0))
    ]
    found = [
        library_data(rows, BatchSettings(GraspModel(friction_error=error, location_error=location)))
        for error, location in ((0.1, "1 mm"), (0.0, 0.0), (0.1, 0.0), (0.0, 0.7))
    ]
    assert [curve["at"] for curve in found[0]["curves"]] == [
        ["0.5", "0", "2°", "0"],
        ["0.5", "0", "2°", "1 mm"],
        ["0.5", "0.1", "2°", "0"],
        ["0.5", "0.1", "2°", "1 mm"],
    ]
    assert {axis["title"]: axis["values"] for axis in found[0]["axes"]} == {
        "Friction μ": ["0.5"],
        "Friction error": ["0", "0.1"],
        "Normal error": ["2°"],
        "Location error": ["0", "1 mm"],
    }
    assert [data["curve"] for data in found] == [3, 0, 2, 1]
    assert [data["uncertain"] for data in found] == [True, False, True, True]
    assert all(curve["meshes"] == [2, 2] for curve in found[0]["curves"])
    assert library_data([], BatchSettings())["curve"] == 0


def test_values_of_an_axis_ascend_as_numbers() -> None:
    row = Row(
        "a.ply",
        unit="mm",
        fractions=tuple(
            AreaFractions(mu, 0.0, 0.5, 0.5, 0.0, 0.0, math.radians(degrees))
            for mu in (10.0, 2.0, 0.5)
            for degrees in (10.0, 9.0)
        ),
    )
    axes = {axis["name"]: axis["values"] for axis in library_data([row], BatchSettings())["axes"]}
    assert axes["friction"] == ["0.5", "2", "10"]
    assert axes["normalError"] == ["9°", "10°"]


@pytest.mark.slow
def test_only_safe_labels_are_called_safe(box: SurfaceLabels) -> None:
    exact, three = GraspModel(location_error=0.001), GraspModel(location_error=0.001, fingers=3)
    assert library_data([], BatchSettings(exact))["certainty"] == ""
    text = "every S and U is correct, an M may be one of them"
    assert library_data([], BatchSettings(three))["certainty"] == text
    assert decoded(object_script(box, "box", ()))[0]["certainty"] == ""
    search = MultifingerSampling(candidates=8)
    safe = label_surface(cylinder_mesh(0.5, 1.0, max_edge=0.5), three, sampling=search)
    assert decoded(object_script(safe, "cylinder", ()))[0]["certainty"] == text


def test_uncertainties_are_described() -> None:
    model = GraspModel(
        friction=(0.4, 0.6),
        normal_error=2.0 * DEGREE,
        location_error="1mm",
        per_finger="location_error=1mm, normal_error=2; friction=0.3..0.4",
    )
    text = dict(describe_settings(BatchSettings(model)))
    assert text["Friction"] == "μ 0.4 to 0.6 (cone of β 21.8° to 30.96°)"
    assert text["Normals"] == "within a further 2°"
    assert text["Contact locations"] == "within 1 mm"
    fingers = "finger 1: normals ± 2°, locations ± 1 mm more; finger 2: friction 0.3 to 0.4"
    assert text["Each finger"] == fingers
    summary = summarise_settings(BatchSettings(model))
    assert {"Normals within a further 2°", "Contact locations within 1 mm"} <= set(summary)
    assert not {"Normals", "Contact locations", "Each finger"} & set(
        dict(describe_settings(BatchSettings()))
    )


def test_describe_settings() -> None:
    text = dict(describe_settings(BatchSettings()))
    assert text["Friction"] == "μ 0.5 (cone of β 26.57°)"
    assert text["Sensor resolution"] == "α 22.6°"
    assert text["Grip"] == "squeeze"
    assert text["Labels"].endswith("exact")
    assert text["Opening"] == "without limits"
    limited = BatchSettings(
        GraspModel(method="extremes", edges=8, actuation="per_finger", torsion_radius=0.01),
        Sampling(min_opening=0.01, max_opening=0.08, grip="both", search_angle=1.0),
        MeshOptions(patch_radius=0.002, max_edge=0.01, unit="m"),
    )
    text = dict(describe_settings(limited))
    assert text["Opening"] == "at least 0.01 and at most 0.08 (in each mesh's unit)"
    assert text["Grip"] == "squeeze or expand"
    assert text["Labels"] == "from wrench hulls at 8 extreme normals, sampled"
    assert text["Epsilon"] == "cones of 8 edges, each finger's force at most 1"
    assert text["Fingers"] == "2, soft"
    assert {"Torsion radius", "Patch radius", "Longest edge", "Unit of the files"} <= set(text)
    assert text["Search"] == "grasps with β* up to 57.3°"
    three_fingers = BatchSettings(GraspModel(fingers=3), MultifingerSampling(max_spread=0.12))
    text = dict(describe_settings(three_fingers))
    assert text["Distances between contacts"] == "at most 0.12 (in each mesh's unit)"
    assert "Grip" not in text
    for sampling, expected in (
        (Sampling(min_opening=5.0, max_opening="8cm"), "5 (in each mesh's unit) and at most 8 cm"),
        (
            Sampling(min_opening="5mm", max_opening=0.1),
            "5 mm and at most 0.1 (in each mesh's unit)",
        ),
        (Sampling(min_opening="5mm", max_opening="8cm"), "5 mm and at most 8 cm"),
    ):
        text = dict(describe_settings(BatchSettings(sampling=sampling)))
        assert text["Opening"] == f"at least {expected}"


def test_the_header_has_the_limits_of_the_search() -> None:
    assert summarise_settings(BatchSettings()) == [
        "Friction μ 0.5 (cone of β 26.57°)", "Sensor resolution α 22.6°", "2 fingers",
        "Grip squeeze", "Opening without limits",
    ]  # fmt: skip
    soft = GraspModel(fingers=3, torsion_radius=0.01)
    limited = BatchSettings(soft, MultifingerSampling(max_spread=0.12, search_angle=1.0))
    assert summarise_settings(limited)[2:] == [
        "3 soft fingers", "Distances between contacts at most 0.12 (in each mesh's unit)",
        "Search grasps with β* up to 57.3°",
    ]  # fmt: skip


def test_report_is_a_folder_of_four_files(tmp_path: Path, box: SurfaceLabels) -> None:
    write_report(Folder(str(tmp_path)), [row_of(box, "box.ply", "box")], BatchSettings(MODEL))
    names = {path.name for path in (tmp_path / "report").iterdir()}
    assert names == {"index.html", "object.html", "viewer.js", "viewer.css"}
    page = (tmp_path / "report" / "index.html").read_text(encoding="utf-8")
    assert "<!--STYLE-->" not in page
    assert not re.search(r'(src|href)="(https?:)?//', page)


def test_pages_run_only_their_own_scripts(tmp_path: Path, box: SurfaceLabels) -> None:
    write_report(Folder(str(tmp_path)), [row_of(box, "box.ply", "box")], BatchSettings(MODEL))
    for name in ("index.html", "object.html"):
        page = (tmp_path / "report" / name).read_text(encoding="utf-8")
        policy = re.search(r'Content-Security-Policy" content="([^"]+)"', page)
        assert policy is not None
        scripts = policy[1].partition("script-src ")[2].partition(";")[0]
        inline = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
        hashes = [
            f"'sha256-{base64.b64encode(hashlib.sha256(one.encode()).digest()).decode()}'"
            for one in inline
        ]
        assert scripts == (" ".join(hashes) or "'self' file:")
        assert policy[1].startswith("default-src 'none'")


def test_names_and_errors_of_meshes_are_not_markup(tmp_path: Path, box: SurfaceLabels) -> None:
    row = row_of(box, EVIL, "box")
    rows = [
        row,
        Row(EVIL, outcome=Outcome.REFUSED, error=EVIL),
        Row("a\udcff.ply", error="\x1b[0m"),
    ]
    write_report(Folder(str(tmp_path)), rows, BatchSettings(MODEL))
    for name, element in (("index.html", "data"), ("object.html", "library")):
        page = (tmp_path / "report" / name).read_text(encoding="utf-8")
        start = page.index(f'<script type="application/json" id="{element}">')
        text = page[page.index(">", start) + 1 : page.index("</script>", start)]
        assert "alert(1)" in text
        assert not set("<>&") & set(text)
        json.loads(text)
        assert page.count("alert(1)") == text.count("alert(1)")
    data = json.loads(text)
    assert data == [["box", EVIL.replace("\u202e", "\\u202e")]]


@pytest.mark.parametrize("rows", [[], [Row("a.ply", outcome=Outcome.LOST, error="missing")]])
def test_a_report_without_labelled_meshes_is_written(tmp_path: Path, rows: list[Row]) -> None:
    write_report(Folder(str(tmp_path)), rows, BatchSettings())
    assert "missing" in (tmp_path / "report" / "index.html").read_text("utf-8") or not rows


def test_bundles_are_made_from_these_sources() -> None:
    """Fails for an outdated bundle: build it again in web/ with npm ci && npm run build."""
    names = [
        path.relative_to(WEB).as_posix() for path in (WEB / "src").rglob("*") if path.is_file()
    ]
    digest = hashlib.sha256()
    for name in sorted([*names, "build.mjs", "package.json", "package-lock.json"]):
        text = (WEB / name).read_text(encoding="utf-8")
        digest.update(f"{name}\0{text}\0".encode())
    for path in STATIC.iterdir():
        assert digest.hexdigest() in path.read_text(encoding="utf-8")[:400], path.name


def test_bundles_contain_the_licences_of_their_packages() -> None:
    for name, packages in (("viewer.js", ["three"]), ("library.js", ["tabulator-tables", "uplot"])):
        text = (STATIC / name).read_text(encoding="utf-8")
        versions = json.loads((WEB / "package.json").read_text(encoding="utf-8"))["devDependencies"]
        for package in packages:
            assert f"{package} {versions[package]}\n" in text[:8000]
        assert text[:8000].count("Permission is hereby granted") == len(packages)


def test_lock_file_names_no_registry() -> None:
    assert "resolved" not in (WEB / "package-lock.json").read_text(encoding="utf-8")


@pytest.mark.slow
def test_building_again_gives_the_same_bundles(tmp_path: Path) -> None:
    node = shutil.which("node")
    if node is None or not (WEB / "node_modules").is_dir():
        pytest.skip("needs node, and web/node_modules from npm ci")
    subprocess.run([node, "build.mjs", str(tmp_path)], cwd=WEB, check=True, capture_output=True)
    for path in STATIC.iterdir():
        assert (tmp_path / path.name).read_bytes() == path.read_bytes(), path.name
