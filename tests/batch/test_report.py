import io
import math
import re
from dataclasses import replace
from pathlib import Path
from urllib.parse import unquote, urljoin, urlsplit

import numpy as np
import pytest
from lxml.html import HtmlElement, document_fromstring
from numpy.typing import NDArray
from PIL import Image

from grasp3d import (
    GraspModel,
    Label,
    Load,
    MeshOptions,
    ObjectMesh,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
)
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.report import thumbnail, write_report
from grasp3d.batch.report.thumbnails import ELEVATIONS, HEIGHT, WIDTH
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.settings import DEGREE
from grasp3d.stability.label import COLORS
from tests.helpers.shapes import LIBRARY
from tests.helpers.solids import box_mesh, sphere_mesh
from tests.helpers.vertex_labels import with_critical_angles

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
    ball = sphere_mesh(subdivisions=5)  # of larger faces pictures differ by processor
    shown = pixels(thumbnail(painted(ball, ball.vertices[:, 2] > 0.0)))
    fraction = shown[Label.S].sum() / shown[None].sum()
    expected = [(1.0 + math.sin(elevation)) / 2.0 for elevation, _ in ELEVATIONS]
    assert min(abs(fraction - one) for one in expected) < 0.025
    assert shown[Label.M].sum() < 0.025 * shown[None].sum()  # where S and U are mixed
    upper, lower = (np.nonzero(shown[label])[0].mean() for label in (Label.S, Label.U))
    assert upper < lower  # rows are counted from above


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


def row_of(labels: SurfaceLabels, name: str, stem: str) -> Row:
    """Row of a labelled mesh, with the files of its stem."""
    return Row(
        mesh=name,
        labels=f"labels/{stem}.ply",
        fields=f"fields/{stem}.parquet",
        thumbnail=f"report/thumbnails/{stem}.webp",
        vertices=len(labels.mesh.vertices),
        size=labels.mesh.size,
        unit="cm",
        critical_angle_p50=0.2,
        margin_p50=-0.1,
        required_resolution_80=0.3,
        epsilon_p50=0.123456,
        seconds=1.25,
        **dict(zip(("stable", "ambiguous", "no_grasp_found"), (0.25, 0.5, 0.25), strict=True)),
    )


def page_of(folder: Path, rows: list[Row], settings: BatchSettings | None = None) -> HtmlElement:
    write_report(Folder(str(folder)), rows, settings or BatchSettings(MODEL))
    return document_fromstring((folder / "report" / "index.html").read_bytes())


def settings_of(page: HtmlElement) -> dict[str, str]:
    """The settings of the page, by name."""
    (texts,) = page.xpath("//h2[text()='Settings']/following-sibling::dl[1]")
    names, values = ([one.text_content() for one in texts.xpath(part)] for part in ("dt", "dd"))
    return dict(zip(names, values, strict=True))


def table_of(page: HtmlElement) -> list[dict[str, str]]:
    """The text of each cell, by the title of its column."""
    heads = [cell.text_content() for cell in page.xpath("//thead//th")]
    rows = page.xpath("//tbody/tr")
    texts = [[" ".join(cell.text_content().split()) for cell in row.xpath("td")] for row in rows]
    return [dict(zip(heads, row, strict=True)) for row in texts]


def test_the_table_has_the_values_of_the_rows(tmp_path: Path, box: SurfaceLabels) -> None:
    row = replace(row_of(box, "tools/box.ply", "tools/bo%x"), warnings="is open")
    held = replace(
        row, critical_angle_p50=math.inf, margin_p50=-math.inf, required_resolution_80=0.0,
        verdict="surely", verdict_text="surely held: 3 grasps.", payload_best=1.234, held=0.5,
        grip_force_needed=math.inf, causes="too wide",
    )  # fmt: skip
    lost = Row("lost.ply", outcome=Outcome.LOST, error="lost.ply: too slow", seconds=3.0)
    page = page_of(tmp_path, [row, lost, held])
    first, second, third = table_of(page)
    assert first == {
        "": "", "Mesh": "tools/box.ply labels table", "Verdict": "",
        "S / M / U": "25 % · 50 % · 25 %",
        "β* median": "11.5°", "Margin median": "-5.7°", "α for 80 %": "17.2°", "ε median": "0.123",
        "Payload": "", "Grip force": "", "Held": "", "Size": f"{box.mesh.size:.3f} cm",
        "Vertices": f"{len(box.mesh.vertices)}", "Seconds": "1.25", "Warnings": "is open",
    }  # fmt: skip
    assert second == dict.fromkeys(first, "") | {
        "Mesh": "lost.ply lost", "Warnings": "lost.ply: too slow",
    }  # fmt: skip
    assert third["Verdict"] == "surely 3 grasps."
    assert [third[name] for name in ("β* median", "Margin median", "α for 80 %")] == [
        "no grasp", "no grasp", "none",
    ]  # fmt: skip
    assert (third["Payload"], third["Grip force"], third["Held"]) == ("1.23 kg", "none", "50 %")
    assert page.xpath("//p[@class='counts']")[0].text_content() == "2 labelled0 refused1 lost"
    assert page.xpath("//td[@title='too wide']")


def test_the_page_links_the_files_of_each_mesh(tmp_path: Path, box: SurfaceLabels) -> None:
    page = page_of(tmp_path, [row_of(box, "box.ply", "kitchen 100%/#spray?")])
    addresses = page.xpath("//tbody//a/@href | //tbody//img/@src")
    base = (tmp_path / "report" / "index.html").as_uri()
    found = {unquote(urlsplit(urljoin(base, one)).path) for one in addresses}
    assert found == {
        str(tmp_path / name)
        for name in (
            "labels/kitchen 100%/#spray?.ply",
            "fields/kitchen 100%/#spray?.parquet",
            "report/thumbnails/kitchen 100%/#spray?.webp",
        )
    }


@pytest.mark.parametrize(
    ("model", "safe"), [(GraspModel(), False), (GraspModel(location_error=0.001), True)]
)
def test_only_safe_labels_are_called_safe(tmp_path: Path, model: GraspModel, safe: bool) -> None:
    text = page_of(tmp_path, [], BatchSettings(model)).text_content()
    assert ("Labels are safe: every S and U is correct, an M may be one of them" in text) is safe


def test_the_page_lists_the_settings_as_files_hold_them(tmp_path: Path) -> None:
    model = GraspModel(friction=(0.4, 0.6), location_error="1mm")
    load = Load(mass=0.5, task="weight within 30 of -z", grip_force=40.0)
    settings = BatchSettings(
        model,
        Sampling(max_opening="8cm"),
        MeshOptions(center_of_mass="1mm,0,0", max_edge=0.01),
        reach=ReachSettings(
            hand=ParallelGripper.preset("franka"), table="stable", pose_error="5mm,3deg"
        ),
        load=load,
    )
    found = settings_of(page_of(tmp_path, [], settings))
    expected = {
        "friction": "0.4..0.6", "location_error": "0.001", "max_opening": "0.08", "grip": "squeeze",
        "search_angle": "None", "hand": "franka", "table": "stable", "pose_error": "5 mm,3 deg",
        "mass": "0.5", "task": "weight within 30 of -z", "grip_force": "40.0", "unit": "None",
        "center_of_mass": "0.001,0.0,0.0", "max_edge": "0.01",
    }  # fmt: skip
    assert {name: found[name] for name in expected} == expected
    others = settings_of(page_of(tmp_path, [], BatchSettings()))
    assert not {"hand", "table", "task", "mass"} & set(others)


def test_names_and_errors_of_meshes_are_not_markup(tmp_path: Path, box: SurfaceLabels) -> None:
    rows = [
        replace(row_of(box, EVIL, "box"), verdict="not", verdict_text=EVIL, causes=EVIL),
        Row(EVIL, outcome=Outcome.REFUSED, error=EVIL),
        Row("a\udcff.ply", error="\x1b[0m"),
    ]
    page = page_of(tmp_path, rows)
    assert not page.xpath("//script | //*[@onerror]")
    shown = EVIL.replace("\u202e", "\\u202e")
    assert [row["Mesh"].removesuffix(" labels table") for row in table_of(page)] == [
        shown, f"{shown} refused", "a\\udcff.ply",
    ]  # fmt: skip
    assert [row["Warnings"] for row in table_of(page)] == ["", shown, "\\x1b[0m"]


def test_the_page_loads_nothing_from_a_network(tmp_path: Path, box: SurfaceLabels) -> None:
    page = page_of(tmp_path, [row_of(box, "box.ply", "box")])
    (policy,) = page.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    assert policy.startswith("default-src 'none'")
    assert not re.search("script|http", policy)
    assert [path.name for path in (tmp_path / "report").iterdir()] == ["index.html"]


@pytest.mark.parametrize("rows", [[], [Row("a.ply", outcome=Outcome.LOST, error="missing")]])
def test_a_report_without_labelled_meshes_is_written(tmp_path: Path, rows: list[Row]) -> None:
    assert [row["Warnings"] for row in table_of(page_of(tmp_path, rows))] == ["missing"] * len(rows)
