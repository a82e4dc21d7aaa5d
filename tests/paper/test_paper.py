import math
import re
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh
from PIL import Image

from grasp3d import GraspModel, critical_friction_angle, load_mesh
from grasp3d.cli import main
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.paper import writing
from grasp3d.paper.writing import (
    DEGREES,
    FIGURES,
    SLIPPERY,
    PaperSettings,
    ScannedObject,
    best_contact_point,
    numbers_page,
    object_figure,
    real_object,
    solids,
    view_of,
)
from grasp3d.pictures.opengl import can_render
from tests.helpers import shapes
from tests.helpers.figures import check_texts
from tests.helpers.solids import box_mesh

PAPER = PaperSettings()
NAMES = [
    *(f"figure_{number:02d}" for number in range(4, 12)),
    *(f"surface_{name}" for name in ("box", "cylinder", "sphere")),
]
SURFACES = {f"surface_{name}.svg" for name in ("box", "cylinder", "sphere", "object")}
QUOTED = "The numbers in the text"

pytestmark = pytest.mark.slow  # the page of numbers takes seconds


@cache
def scanned() -> tuple[ScannedObject, ...]:
    """Sphere, box and cylinder."""
    return tuple(solids(PAPER))


def rows_of(page: str, title: str) -> dict[tuple[str, ...], list[str]]:
    """Cells of the table under a heading, by their first two."""
    under = page.split(f"## {title}", 1)[1].split("\n## ", 1)[0]
    lines = [line for line in under.splitlines() if line.startswith("|")][2:]
    cells = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return {(row[0], row[1]): row for row in cells}


def number(cell: str) -> float:
    found = re.search(r"-?\d+(\.\d+)?", cell)
    assert found
    return float(found[0])


@pytest.fixture(scope="module")
def page() -> str:
    return numbers_page(PAPER, scanned())


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"friction": 0.0}, "friction"),
        ({"sensor_resolutions": ()}, "one or two"),
        ({"sensor_resolutions": (0.1, 0.1)}, "must be different"),
        ({"sensor_resolutions": (4.0,)}, "below 180"),
    ],
)
def test_settings_that_cannot_be_drawn_are_refused(
    settings: dict[str, object], message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        PaperSettings(**settings)  # type: ignore[arg-type]


@pytest.mark.parametrize("name", FIGURES)
def test_no_text_of_a_figure_is_hidden(name: str) -> None:
    check_texts(FIGURES[name](PaperSettings(friction=0.2)))


def test_numbers_of_the_text_agree_with_their_closed_forms(page: str) -> None:
    rows = rows_of(page, QUOTED)
    by_start = {first: row for (first, _), row in rows.items()}
    for friction, radius in ((0.5, 10.0), (0.2, 10.0)):
        alpha = 2.0 * math.atan(friction)
        tip = f"fingertip of 2 cm diameter, μ = {friction:g}"
        end = f"μ = {friction:g} (Sec. IV-A)"
        bound = next(row for first, row in by_start.items() if first.endswith(end))
        assert number(bound[2]) == pytest.approx(math.degrees(alpha), abs=0.005)
        assert number(by_start[f"arc, {tip}"][2]) == pytest.approx(radius * alpha, abs=0.005)
        counted = by_start[f"sensors, {tip}"][2]
        discs = math.ceil(2.0 * math.pi * radius**2 / (math.pi * (radius * alpha / 2.0) ** 2))
        caps = math.ceil(1.0 / (1.0 - math.cos(alpha / 2.0)))
        assert counted == f"{discs} (equal discs), {caps} (spherical caps)"
    assert by_start["sensors, fingertip of 2 cm diameter, μ = 0.5"][1] == "at least 10"
    differing = by_start["sensors, fingertip of 2 cm diameter, μ = 0.2"]
    assert differing[1] == "50"
    assert differing[4].startswith("**differs**")
    assert differing[4].endswith(f"gives {math.ceil(8.0 / 0.4**2)}")


def test_the_fraction_read_from_the_paper_is_quoted_and_compared(page: str) -> None:
    rows = rows_of(page, QUOTED)
    ambiguous = {key[0]: row for key, row in rows.items() if key[0].startswith("ambiguous at")}
    circle, square, sphere = ambiguous.values()
    alpha = math.radians(22.6)
    assert circle[1] == "almost 20 %"
    assert number(circle[2]) == pytest.approx(100.0 * 2.0 * alpha / math.pi, abs=0.05)
    assert "differs" in circle[4]
    # Opposite side: |x| <= 2 tan(beta - a) .. ; neighbours: the line within beta + a of both.
    low, high = math.radians(45.0 - 11.3), math.radians(45.0 + 11.3)
    side = 1.0 / math.tan(low) - 1.0 / math.tan(high)
    assert number(square[2]) == pytest.approx(100.0 * 2.0 * side / 8.0, abs=0.05)
    expected = [100.0 * math.sin(2.0 * math.atan(mu)) * math.sin(alpha) for mu in (0.2, 1.0)]
    assert [number(part) for part in sphere[2].split(" to ")] == pytest.approx(expected, abs=0.05)


def test_tips_have_their_location_normals_and_friction(page: str) -> None:
    rows = list(rows_of(page, "Receptive field and location").values())
    assert [row[0] for row in rows] == ["flat", "round, radius 10 mm"] * 2
    for row in rows:
        flat, field = row[0] == "flat", number(row[1])
        assert number(row[2]) == field / 2.0
        alpha = 0.0 if flat else field / 10.0
        assert number(row[3]) == pytest.approx(math.degrees(alpha), abs=0.05)
        for column, opening in zip(range(4, 7), (20.0, 40.0, 80.0), strict=True):
            tip = [field / 2.0, 0.0]
            if not flat:
                tip = [10.0 * math.sin(alpha / 2.0), 10.0 * (1.0 - math.cos(alpha / 2.0))]
            turn = math.atan(tip[0] / (opening / 2.0 + tip[1]))
            assert number(row[column]) == pytest.approx(math.degrees(turn), abs=0.051)
            friction = math.tan(turn + alpha / 2.0)
            assert float(row[column + 3]) == pytest.approx(friction, abs=6e-4)


def test_fractions_of_the_circle_agree_with_their_closed_form(page: str) -> None:
    for friction in (1.0, SLIPPERY):
        beta = math.degrees(math.atan(friction))
        rows = rows_of(page, f"The circle over the resolution, μ = {friction:g}")
        assert len(rows) == len(DEGREES)
        for row in rows.values():
            alpha = number(row[0])
            stable = max(0.0, (beta - alpha / 2.0) / 90.0)
            unstable = max(0.0, 1.0 - (beta + alpha / 2.0) / 90.0)
            fractions = [stable, 1.0 - stable - unstable, unstable]
            assert [number(cell) for cell in row[1:4]] == pytest.approx(
                [100.0 * fraction for fraction in fractions], abs=0.051
            )
            ceiling = stable + unstable + fractions[1] / 2.0
            assert number(row[4]) == pytest.approx(100.0 * ceiling, abs=0.051)


def test_the_least_epsilon_of_round_cones_is_that_at_the_effective_friction(page: str) -> None:
    rows = list(rows_of(page, "ε at the effective friction").values())
    for cut, full in zip(rows[::2], rows[1::2], strict=True):
        assert number(cut[4]) > number(cut[3]) + 0.01
        assert float(full[5]) < 1e-4
        assert number(full[4]) < number(full[2])


def test_the_sphere_agrees_with_its_closed_form(page: str) -> None:
    rows = rows_of(page, "In space")
    for alpha in (30.0, 15.0):
        row = rows["sphere", f"{alpha:g}°"]
        stable = 100.0 * math.sin(math.radians(45.0 - alpha / 2.0)) ** 2
        ambiguous = 100.0 * math.sin(math.radians(90.0)) * math.sin(math.radians(alpha))
        expected = [stable, ambiguous, 100.0 - stable - ambiguous]
        assert [number(cell) for cell in row[6:9]] == pytest.approx(expected, abs=0.051)
        assert [number(cell) for cell in row[2:5]] == pytest.approx(expected, abs=0.5)


def test_the_fixed_finger_is_at_a_best_contact_point() -> None:
    vertices, faces = shapes.lopsided()
    mesh = load_mesh((vertices[:, ::-1], faces[:, ::-1]), max_edge=9.0)
    model = GraspModel(friction=0.6, sensor_resolution=math.radians(20.0))
    point = best_contact_point(mesh, model)
    scanned = real_object(mesh, "blob", PaperSettings(0.6, (model.sensor_resolution,)))
    assert scanned.scans[0].partners[0, 0] == pytest.approx(point)
    critical = scanned.scans[0].critical_angle
    best = int(critical.argmin())
    pair = Contacts(
        [point, mesh.vertices[best]], [scanned.scans[0].partner_normals[0, 0], mesh.normals[best]]
    )
    assert critical_friction_angle(pair) == pytest.approx(critical[best], abs=1e-9)
    assert critical[best] < math.radians(3.0)
    assert scanned.scans[0].fractions()["S"] > 0.01


def test_an_object_without_a_grasp_is_refused() -> None:
    sheet = load_mesh(([[0, 0, 0], [1, 0, 0], [0, 1, 0.0]], [[0, 1, 2]]))
    with pytest.raises(SettingError, match="no grasp was found"):
        best_contact_point(sheet, GraspModel())


@pytest.mark.parametrize(
    "normal", [(1, 0, 0), (0, -1, 0), (0.6, 0.64, 0.48), (0, 0, 1), (0, 0, -1)]
)
def test_the_view_has_the_finger_at_the_side_and_the_opposing_contact_in_front(
    normal: tuple[float, float, float],
) -> None:
    inward = np.array(normal)
    across, up, toward = view_of(inward).axes @ -inward
    assert -0.5 < toward < 0.0  # the finger is a little behind the object, the opposing one before
    assert math.hypot(across, up) > 0.85


def test_without_pictures_only_the_fractions_are_drawn() -> None:
    sphere = scanned()[0]
    figure = object_figure(sphere, PAPER, pictures=False)
    assert len(figure.axes) == 1
    check_texts(figure)
    dashed = [np.asarray(line.get_ydata()) for line in figure.axes[0].lines]
    alpha = PAPER.swept
    within = alpha <= math.pi / 2.0
    stable = 100.0 * np.sin(math.pi / 4.0 - alpha[within] / 2.0) ** 2
    assert dashed[0][within] == pytest.approx(stable)
    assert dashed[1][within] == pytest.approx(100.0 - stable)


def test_a_file_with_the_folders_name_is_kept(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "out").write_text("mine")
    assert main(["paper", "-o", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.startswith("grasp3d: ")
    (tmp_path / "folder" / "numbers.md").mkdir(parents=True)
    assert main(["paper", "-o", str(tmp_path / "folder")]) == 2
    assert "numbers.md: is a folder" in capsys.readouterr().err
    assert (tmp_path / "out").read_text() == "mine"
    assert [path.name for path in (tmp_path / "folder").iterdir()] == ["numbers.md"]


def test_the_command_writes_all_of_the_paper(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """With OpenGL, if there is any; and fewer figures without it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(writing, "solids", lambda _: scanned())
    box = box_mesh((2.0, 3.0, 4.0), max_edge=1.0)
    trimesh.Trimesh(box.vertices, box.faces, process=False).export("box.off")
    first, second = Path("first"), Path("second/deeper")
    first.mkdir()
    for name in ("mine.txt", "figure_05.svg"):
        (first / name).write_text("old")
    assert main(["paper", "-o", "first", "--object", "box.off"]) == 0
    printed = capsys.readouterr().out
    names = [f"{name}{end}" for name in (*NAMES, "surface_object") for end in (".png", ".svg")]
    assert {path.name for path in first.iterdir()} == {*names, "numbers.md", "mine.txt"}
    assert (first / "mine.txt").read_text() == "old"
    for name in names:
        path = first / name
        assert 8_000 < path.stat().st_size < 900_000
        if path.suffix == ".svg":
            svg = path.read_text(encoding="utf-8")
            assert ET.fromstring(svg).tag.endswith("svg")  # noqa: S314, our own file
            assert svg.count("<image") == (2 if can_render() and name in SURFACES else 0)
        else:
            with Image.open(path) as image:
                assert min(image.size) > 700
                assert len(np.unique(np.asarray(image.convert("L")))) > 30
    assert f"written: {len(names) + 1} files in first" in printed
    assert "--object" not in printed
    monkeypatch.setattr(writing, "can_render", lambda: False)
    monkeypatch.setattr(writing, "FIGURES", {"figure_04": FIGURES["figure_04"]})
    monkeypatch.setattr(writing, "numbers_page", lambda *_: "numbers")
    paper = writing.write_paper(second, PAPER)
    without, missing = paper.notes
    assert "so surface_sphere, surface_box, surface_cylinder show the area fractions" in without
    assert "--object FILE" in missing
    assert "<image" not in (second / "surface_box.svg").read_text()
    same = "figure_04.svg"
    assert (first / same).read_bytes() == (second / same).read_bytes()
    # The box of the paper and that of the object, at two resolutions.
    assert (first / "numbers.md").read_text().count("| box") == 4
    assert (second / "numbers.md").read_text() == "numbers"
