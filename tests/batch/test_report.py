"""The report: what its pages say, and what a real browser makes of them."""

import base64
import hashlib
import io
import json
import math
import re
from dataclasses import replace
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urljoin, urlsplit

import numpy as np
import pytest
import trimesh
from lxml.html import HtmlElement, document_fromstring
from PIL import Image

from grasp3d import GraspModel, MeshOptions, Sampling, SurfaceLabels, label_surface
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.library import label_library
from grasp3d.batch.object_page import SIZE, SMALLER, write_object
from grasp3d.batch.report_page import write_report
from grasp3d.batch.row import COLUMNS, Outcome, Row
from grasp3d.describe import facts
from grasp3d.grasps.best import best_grasps
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.settings import DEGREE
from grasp3d.system.places import place
from tests.helpers.browsers import quiet_page
from tests.helpers.solids import box_mesh

EVIL = (
    "a/</script><script>alert(1)</script><img src=x onerror=alert(2)>"
    "<!--SCRIPT-->\u202e&amp;'\".ply"
)
MODEL = GraspModel(friction=0.3, sensor_resolution=20.0 * DEGREE)
COARSE = Sampling(rays=8, search_angle=60.0 * DEGREE)
JOINED = "fam\u200dily soft\u00adhyphen n\u200cim"


@pytest.fixture(scope="module")
def box() -> SurfaceLabels:
    mesh = box_mesh((0.1, 0.2, 0.3), max_edge=0.05)
    return label_surface(mesh, MODEL, sampling=COARSE)


def row_of(labels: SurfaceLabels, name: str, stem: str) -> Row:
    """Row of a labelled mesh, with the files of its stem."""
    row = Row(
        mesh=name, surface=f"surfaces/{stem}.ply",
        thumbnail=f"report/objects/{stem}.webp", page=f"report/objects/{stem}.html",
    ).of(labels)  # fmt: skip
    return replace(row, seconds=1.25, warnings="is open")


def page_of(folder: Path, rows: list[Row], settings: BatchSettings | None = None) -> HtmlElement:
    write_report(place(str(folder)), rows, settings or BatchSettings(MODEL))
    return document_fromstring((folder / "report" / "index.html").read_bytes())


def data_of(page: HtmlElement) -> dict[str, Any]:
    """What the table shows."""
    (text,) = page.xpath("//script[@id='data']/text()")
    return dict(json.loads(text))


def test_the_table_has_the_values_of_the_rows(tmp_path: Path, box: SurfaceLabels) -> None:
    row = replace(
        row_of(box, "tools/box.ply", "tools/bo%x/#spray?"), critical_angle_p50=0.2, margin_p50=-0.1,
        required_resolution_80=0.3, epsilon_p50=0.123456, size=0.3742, unit="m",
    )  # fmt: skip
    held = replace(
        row, critical_angle_p50=math.inf, margin_p50=-math.inf, required_resolution_80=0.0,
        verdict="surely", verdict_text="Surely held: 3 grasps.", payload_best=1.234, held=0.5,
        grip_force_needed=math.inf, causes="too wide",
    )  # fmt: skip
    lost = Row("lost.ply", outcome=Outcome.LOST, error="lost.ply: too slow", seconds=3.0)
    page = page_of(tmp_path, [row, lost, held])
    data, heads = data_of(page), [one.text_content() for one in page.xpath("//thead//th")]
    assert heads[:4] == ["", "Mesh", "Verdict", "S / M / U"]
    assert heads[-1] == "Warnings"
    cells = dict(zip(heads[4:-1], data["cells"], strict=True))
    assert cells == {
        "β* median": ["11.5°", "", "no grasp"], "Margin median": ["-5.7°", "", "no grasp"],
        "α for 80 %": ["17.2°", "", "none"], "ε median": ["0.123", "", "0.123"],
        "Payload": ["", "", "1.23 kg"], "Grip force": ["", "", "none"], "Held": ["", "", "50 %"],
        "Size": ["0.374 m", "", "0.374 m"], "Vertices": [str(row.vertices), "", str(row.vertices)],
        "Seconds": ["1.25", "", "1.25"],
    }  # fmt: skip
    assert data["mesh"] == ["tools/box.ply", "lost.ply", "tools/box.ply"]
    base = (tmp_path / "report" / "index.html").as_uri()
    found = {unquote(urlsplit(urljoin(base, one)).path) for one in data["files"][0].values()}
    names = ("surfaces/{}.ply", "report/objects/{}.webp", "report/objects/{}.html")
    assert found == {str(tmp_path / name.format("tools/bo%x/#spray?")) for name in names}
    assert data["verdict"] == [row.verdict, "lost", "surely"]
    assert data["why"][1:] == ["lost.ply: too slow", "3 grasps."]
    assert data["note"] == ["is open", "", "is open"]
    assert data["parts"][0] == [row.stable, row.ambiguous, row.no_grasp_found]
    assert data["causes"][2] == "too wide"
    assert page.xpath("//p[@class='counts']")[0].text_content() == "2 labelled0 refused1 lost"
    for column in COLUMNS.values():
        if column.heading:
            assert page.xpath("//dd[text()=$meaning]", meaning=column.meaning)


def test_the_page_lists_the_settings_as_files_hold_them(tmp_path: Path) -> None:
    model = GraspModel(friction=(0.4, 0.6), location_error="1mm")
    reach = ReachSettings("franka", table="stable", pose_error="5mm,3deg")
    expected = {"friction": "0.4..0.6", "location_error": "0.001", "search_angle": "None",
                "hand": "franka", "table": "stable", "pose_error": "5 mm,3 deg"}  # fmt: skip
    for settings, is_safe in ((BatchSettings(model, reach=reach), True), (BatchSettings(), False)):
        page = page_of(tmp_path, [], settings)
        (texts,) = page.xpath("//h2[text()='Settings']/following-sibling::dl[1]")
        names, values = ([one.text_content() for one in texts.xpath(k)] for k in ("dt", "dd"))
        found = dict(zip(names, values, strict=True))
        assert (found.items() >= expected.items()) == ("hand" in found) == is_safe
        safe = "Labels are safe: every S and U is correct, an M may be one of them"
        assert (safe in page.text_content()) == is_safe


def test_names_and_errors_of_meshes_are_not_markup(tmp_path: Path, box: SurfaceLabels) -> None:
    rows = [
        replace(row_of(box, EVIL, "box"), verdict="not", verdict_text=EVIL, causes=EVIL),
        Row(EVIL, outcome=Outcome.REFUSED, error=EVIL),
        Row("a\udcff.ply", error="\x1b[0m"),
        Row(JOINED),
    ]
    page = page_of(tmp_path, rows)
    assert len(page.xpath("//script")) == 2
    assert not page.xpath("//*[@onerror]")
    data, shown = data_of(page), EVIL.replace("\u202e", "\\u202e")
    assert data["mesh"] == [shown, shown, "a\\udcff.ply", JOINED]
    assert data["why"][1:3] == [shown, "\\x1b[0m"]


def test_only_the_script_of_the_page_may_run(tmp_path: Path) -> None:
    page = page_of(tmp_path, [Row("a.ply", outcome=Outcome.LOST, error="missing")])
    assert data_of(page)["why"] == ["missing"]
    (policy,) = page.xpath("//meta[@http-equiv='Content-Security-Policy']/@content")
    (script,) = page.xpath("//script[not(@type)]/text()")
    digest = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert policy.startswith("default-src 'none'")
    assert re.findall(r"script-src (.*?);", policy) == [f"'sha256-{digest}'"]
    assert "http" not in policy
    assert len(script.splitlines()) <= 100


def embedded(address: str) -> Image.Image:
    """The picture in an address."""
    return Image.open(io.BytesIO(base64.b64decode(address.partition("base64,")[2])))


@pytest.mark.slow
def test_the_page_of_an_object_shows_it_and_its_best_grasps(
    tmp_path: Path, box: SurfaceLabels, monkeypatch: pytest.MonkeyPatch
) -> None:
    best = best_grasps(box, 6)
    row = write_object(row_of(box, EVIL, "box"), box, best, tmp_path, "report/objects/a b/box")
    page = document_fromstring((tmp_path / row.page).read_bytes())
    assert not page.xpath("//script | //*[@onerror]")
    whole, *grasps = page.xpath("//img/@src")
    picture = Image.open(io.BytesIO(base64.b64decode(whole.partition("base64,")[2])))
    assert (picture.size, len(grasps)) == (SIZE, 4)
    listed = page.xpath("//li")
    assert len(listed) == best.size
    for number, one in enumerate(listed):
        names, values = ([each.text for each in one.xpath(f".//{name}")] for name in ("dt", "dd"))
        assert dict(zip(names, values, strict=True)) == facts(best, number)
    base = (tmp_path / row.page).as_uri()
    linked = {unquote(urlsplit(urljoin(base, one)).path) for one in page.xpath("//a/@href")}
    glb = row.page.replace(".html", ".glb")
    assert linked == {str(tmp_path / name) for name in (row.surface, glb, "report/index.html")}
    with Image.open(tmp_path / row.thumbnail) as small:
        assert small.size == (SIZE[0] // SMALLER, SIZE[1] // SMALLER)
    model: Any = trimesh.load_mesh(tmp_path / glb, process=False)
    assert len(np.unique(model.visual.vertex_colors, axis=0)) == len(np.unique(box.label))
    monkeypatch.setattr("grasp3d.batch.object_page.can_render", lambda: False)
    row = write_object(row_of(box, "box", "box"), box, best, tmp_path, "b/b")
    page = document_fromstring((tmp_path / row.page).read_bytes())
    assert (len(page.xpath("//img")), len(page.xpath("//li"))) == (0, best.size)


@pytest.mark.slow
def test_the_table_in_a_browser(tmp_path: Path, box: SurfaceLabels, browser: Any) -> None:
    """Few rows are in the page; they are sorted, sought, and never cut; no name is run."""
    long = "Perhaps held by franka: " + "the sensor cannot tell whether 40 N can hold 0.5 kg. " * 6
    one, random = row_of(box, "box", "box"), np.random.default_rng(1)
    rows = [
        replace(
            one, mesh=f"{number:03} {EVIL if number % 4 == 0 else JOINED}", thumbnail="",
            verdict=str(random.choice(["surely", "perhaps", "not"])), verdict_text=long,
            size=float(random.random()), critical_angle_p50=float(random.choice([0.2, math.inf])),
        )
        for number in range(120)
    ]  # fmt: skip
    rows.append(Row("zzz", outcome=Outcome.LOST, error=EVIL))
    page_of(tmp_path, rows)
    errors: list[str] = []
    page = quiet_page(browser, 1280, errors)
    page.goto((tmp_path / "report" / "index.html").as_uri())

    def column(number: int) -> list[str]:
        return list(page.locator(f"tbody td:nth-child({number + 1})").all_inner_texts())

    assert len(column(1)) == 50
    assert page.locator("#position").inner_text() == "1–50 of 121"
    page.locator("#after").click()
    page.locator("#after").click()
    assert len(column(1)) == 21
    size = page.locator("th", has_text="Size")
    index = int(size.evaluate("one => one.cellIndex"))
    for state, sign in (("ascending", 1.0), ("descending", -1.0)):
        size.locator("button").click()
        assert size.get_attribute("aria-sort") == state
        shown = [sign * float(text.split()[0]) for text in column(index)]
        assert shown == sorted(shown)
    page.locator("#verdict").select_option("surely")
    sure = [row for row in rows if row.verdict == "surely"]
    assert page.locator("#position").inner_text().endswith(f" of {len(sure)}")
    page.locator("#words").fill("007")
    assert len(column(1)) == (rows[7].verdict == "surely")
    page.locator("#words").fill("no such mesh")
    assert page.locator("#position").inner_text() == "none"
    page.locator("#words").fill("")
    page.locator("#verdict").select_option("")
    for width in (1280, 390):
        page.set_viewport_size({"width": width, "height": 900})
        assert page.evaluate("document.documentElement.scrollWidth - innerWidth") <= 0
        cut = (
            "[...document.querySelectorAll('td')].filter(one => one.scrollWidth > one.clientWidth)"
        )
        assert page.evaluate(f"{cut}.length") == 0
    assert errors == []
    page.close()


@pytest.mark.slow
def test_a_library_has_pages_up_to_a_number_of_meshes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "in").mkdir()
    for name in (JOINED, "b"):
        trimesh.creation.box([0.08, 0.05, 0.03]).export(tmp_path / "in" / f"{name}.stl")
    settings = BatchSettings(MODEL, COARSE, MeshOptions(unit="m", max_edge=0.05), best=1)
    pages = {"index.html"}, {f"{name}.stl.{kind}" for name in (JOINED, "b") for kind in
                             ("html", "webp", "glb")}  # fmt: skip
    for most, expected in ((1, pages[0]), (2, pages[0] | pages[1])):
        monkeypatch.setattr("grasp3d.batch.library.MOST_PAGES", most)
        label_library([tmp_path / "in"], tmp_path / str(most), settings)
        report = tmp_path / str(most) / "report"
        assert {path.name for path in report.rglob("*.*") if path.is_file()} == expected
