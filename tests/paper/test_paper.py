import json
import math
import os
import re
import subprocess
import sys
from ctypes.util import find_library
from functools import cache
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest
import trimesh
from matplotlib.image import AxesImage
from PIL import Image

from grasp3d import GraspModel, critical_friction_angle, load_mesh
from grasp3d.cli import main
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.paper.curves import fractions_figure
from grasp3d.paper.writing import (
    DEGREES,
    FIGURES,
    SLIPPERY,
    PaperSettings,
    ScannedObject,
    best_contact_point,
    numbers_page,
    object_figure,
    percent,
    real_object,
    solids,
    swept,
    view_of,
)
from grasp3d.pictures.opengl import WINDOW, can_render
from tests.helpers import shapes
from tests.helpers.figures import check_texts
from tests.helpers.solids import box_mesh

PAPER = PaperSettings()
NAMES = [
    *(f"figure_{number:02d}" for number in range(4, 12)),
    "surface_box",
    "surface_cylinder",
    "surface_sphere",
]
QUOTED = "The numbers in the text"
FLAT = len(FIGURES)
"""Number of names of figures without pictures of surfaces, the first ones."""


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
        ({"sensor_resolutions": (0.1, 0.2, 0.3)}, "one or two .* got 3"),
        ({"sensor_resolutions": (0.1, 0.1)}, "must be different"),
        ({"sensor_resolutions": (4.0,)}, "below 180"),
    ],
)
def test_settings_that_cannot_be_drawn_are_refused(
    settings: dict[str, object], message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        PaperSettings(**settings)  # type: ignore[arg-type]


def test_the_settings_of_the_paper_are_the_defaults() -> None:
    assert PAPER.friction == 1.0
    assert np.degrees(PAPER.sensor_resolutions) == pytest.approx([30.0, 15.0])


@pytest.mark.slow
@pytest.mark.parametrize("name", FIGURES)
@pytest.mark.parametrize("friction", [1.0, 0.2])
def test_no_text_of_a_figure_is_hidden(name: str, friction: float) -> None:
    check_texts(FIGURES[name](PaperSettings(friction=friction)))


def test_the_figures_are_those_of_the_paper() -> None:
    assert list(FIGURES) == NAMES[:FLAT]


@pytest.mark.parametrize("alpha", [1.0, 22.5, 45.0, 89.0])
def test_fractions_of_the_circle_in_its_figure_are_the_closed_form(alpha: float) -> None:
    areas = FIGURES["figure_08"](PAPER).axes[0].collections
    sure = 100.0 * (45.0 - alpha / 2.0) / 90.0
    heights = []
    for area in areas:
        x, y = np.asarray(area.get_paths()[0].vertices).T
        heights.append(np.ptp(y[np.isclose(x, alpha)]))
    assert heights == pytest.approx([sure, 100.0 - 2.0 * sure, sure])


def test_the_ceilings_agree_with_the_reference() -> None:
    reference = json.loads(shapes.shared("reference", "planar.json").read_text())
    lines = {line.get_label(): line for line in FIGURES["figure_11"](PAPER).axes[0].lines}
    for name in ("circle", "square"):
        x, y = (np.asarray(data, float) for data in lines[name].get_data())
        for case in reference[name]:
            if case["mu"] == 1.0 and case["alpha_deg"] < 89.0:
                expected = 100.0 * (case["S"] + case["U"] + case["M"] / 2.0)
                assert np.interp(case["alpha_deg"], x, y) == pytest.approx(expected, abs=0.01)


def test_the_first_curve_of_the_ceilings_is_that_of_the_sphere() -> None:
    sphere = FIGURES["figure_11"](PAPER).axes[0].lines[0]
    assert sphere.get_label() == "sphere (the paper's)"
    degrees, height = (np.asarray(data, float) for data in sphere.get_data())
    within = degrees <= 90.0
    expected = 100.0 - 50.0 * np.sin(np.radians(degrees[within]))  # M = sin 90° sin α
    np.testing.assert_allclose(height[within], expected, atol=1e-9)


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


def test_what_the_paper_expects_of_finer_fingertips_is_beside_ours(page: str) -> None:
    rows = {key[0]: row for key, row in rows_of(page, QUOTED).items()}
    (halved,) = (row for first, row in rows.items() if "→" in first)
    assert halved[0].endswith("(Sec. IV-A)")
    assert halved[1] == "reduced by approximately half"
    assert halved[0].startswith("ambiguous region, α = 53.13° → 22.62°, μ = 1")
    assert "circle: 59.0 % → 25.1 %" in halved[2]
    alphas = [2.0 * math.atan(friction) for friction in (0.5, 0.2)]
    sphere = " → ".join(f"{100.0 * math.sin(alpha):.1f} %" for alpha in alphas)  # sin 90° sin α
    assert f"sphere: {sphere}" in halved[2]
    (ceiling,) = (row for first, row in rows.items() if "(Sec. IV-C)" in first)
    assert ceiling[1] == "not above 90 %"
    expected = 100.0 * (1.0 - math.radians(22.6) / math.pi)
    assert f"circle: {expected:.1f} %" in ceiling[2]
    ours = [float(one) for one in re.findall(r": (\d+\.\d) %", ceiling[2])]
    assert len(ours) == 3
    assert max(ours) <= 90.0


@pytest.mark.slow
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


@pytest.mark.slow
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


@pytest.mark.parametrize("name", ["circle", "square"])
@pytest.mark.parametrize("friction", [1.0, SLIPPERY])
def test_the_four_combinations_fail_beyond_twice_the_friction_angle(
    page: str, name: str, friction: float
) -> None:
    bound = 2.0 * math.degrees(math.atan(friction))
    for row in rows_of(page, f"The {name} over the resolution, μ = {friction:g}").values():
        alpha, differ, with_rings = number(row[0]), number(row[8]), number(row[9])
        assert with_rings == 0.0
        if alpha < bound:
            assert differ == 0.0
            assert [number(cell) for cell in row[5:8]] == pytest.approx(
                [number(cell) for cell in row[1:4]], abs=0.3
            )
        elif alpha > bound + 1.0:
            assert differ > 1.0
            assert number(row[7]) - number(row[3]) == pytest.approx(differ, abs=0.5)  # U for M


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


def test_the_box_agrees_with_random_points() -> None:
    rng = np.random.default_rng(7)
    axis, sign = rng.integers(3, size=40_000), rng.choice([-1.0, 1.0], size=40_000)
    points = rng.uniform(-1.0, 1.0, size=(40_000, 3))
    points[np.arange(40_000), axis] = sign
    normals = np.zeros_like(points)
    normals[np.arange(40_000), axis] = -sign
    apart = points - (0.0, 0.0, -1.0)
    apart /= np.linalg.norm(apart, axis=1, keepdims=True)
    first = np.degrees(np.arccos(apart[:, 2]))
    second = np.degrees(np.arccos(np.clip(-(apart * normals).sum(axis=1), -1.0, 1.0)))
    squeeze, expand = np.maximum(first, second), np.maximum(180.0 - first, 180.0 - second)
    critical = np.minimum(squeeze, expand)
    box = scanned()[1]
    for one, alpha in zip(box.scans, (30.0, 15.0), strict=True):
        found = one.fractions()
        assert found["S"] == pytest.approx((critical < 45.0 - alpha / 2.0).mean(), abs=0.01)
        assert found["U"] == pytest.approx((critical >= 45.0 + alpha / 2.0).mean(), abs=0.01)


def test_fractions_are_written_in_percent_with_one_decimal() -> None:
    assert [percent(fraction) for fraction in (0.0, -0.0, 0.3333, 1.0)] == [
        "0.0 %", "0.0 %", "33.3 %", "100.0 %",
    ]  # fmt: skip


@pytest.mark.slow
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


@pytest.mark.slow
def test_pictures_are_drawn_beside_the_fractions() -> None:
    pictures = [np.full((20, 20, 3), shade, np.uint8) for shade in (90, 200)]
    box = scanned()[1]
    fractions = swept(box.scans[0].angle_distribution(), box.name, PAPER)
    figure = fractions_figure(fractions, "area fraction", scans=box.scans, pictures=pictures)
    check_texts(figure)
    images = [axes.findobj(AxesImage)[0] for axes in figure.axes[:2]]
    for image, picture in zip(images, pictures, strict=True):
        assert (np.asarray(image.get_array()) == picture).all()
    assert [axes.get_title() for axes in figure.axes[:2]] == [
        r"$\alpha$ = 30°", r"$\alpha$ = 15°",
    ]  # fmt: skip
    fractions = box.scans[0].fractions()
    assert f"S {100.0 * fractions['S']:.1f} %" in figure.axes[0].get_xlabel()
    marks = figure.axes[2].lines[0]
    assert np.asarray(marks.get_xdata()) == pytest.approx([30.0, 15.0])


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--sensor-resolution", "10", "20", "30"), "one or two"),
        (("--friction", "0"), "above 0"),
        (("--object", "missing.stl"), "missing.stl: there is no such file"),
    ],
)
def test_errors_are_one_line_and_leave_no_files(
    arguments: tuple[str, ...],
    message: str,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    assert main(["paper", "-o", str(tmp_path / "out"), *arguments]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "out").exists()


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


COMMAND = "import sys; from grasp3d.cli import main; sys.exit(main())"


def both_runs(folder: Path) -> tuple[tuple[Path, str], tuple[Path, str]]:
    """Two parallel runs in separate folders: with OpenGL, if any, and without."""
    box = box_mesh((2.0, 3.0, 4.0), max_edge=1.0)
    trimesh.Trimesh(box.vertices, box.faces, process=False).export(folder / "box.off")
    (folder / "first").mkdir()
    (folder / "first" / "mine.txt").write_text("mine")
    (folder / "first" / "figure_05.svg").write_text("old")
    without = {WINDOW: "vtkOSOpenGLRenderWindow", "DISPLAY": ""}
    started = [
        subprocess.Popen(
            [sys.executable, "-c", COMMAND, "paper", "-o", output, *arguments],
            cwd=folder,
            env={**os.environ, **environment, "COLUMNS": "160"},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        for output, arguments, environment in (
            ("first", ("--object", "box.off"), {}),
            ("second/deeper", (), without),
        )
    ]
    printed = []
    for process in started:
        out, error = process.communicate(timeout=300)
        assert (process.returncode, error) == (0, "")
        printed.append(out)
    return (folder / "first", printed[0]), (folder / "second/deeper", printed[1])


@pytest.mark.slow
def test_the_command_writes_all_of_the_paper(tmp_path: Path) -> None:
    """One test, as both runs take long."""
    (first, printed), (second, without) = both_runs(tmp_path)
    check_files(first, second, printed)
    check_bytes(first, second)
    if find_library("OSMesa") is not None:
        pytest.skip("all but missing pictures is tested: VTK draws with OSMesa here")
    check_pictures(first, second, printed, without)


def check_files(first: Path, second: Path, printed: str) -> None:
    """All files are there, pictures have pixels, and other files are kept."""
    expected = sorted([f"{name}{end}" for name in NAMES for end in (".png", ".svg")])
    objects = ["surface_object.png", "surface_object.svg"]
    assert sorted(path.name for path in second.iterdir()) == sorted([*expected, "numbers.md"])
    assert sorted(path.name for path in first.iterdir()) == sorted(
        [*expected, *objects, "numbers.md", "mine.txt"]
    )
    assert (first / "mine.txt").read_text() == "mine"
    for name in [*expected, *objects]:
        path = first / name
        assert 8_000 < path.stat().st_size < 900_000
        if path.suffix == ".svg":
            assert ET.parse(path).getroot().tag.endswith("svg")  # noqa: S314, our own file
        else:
            with Image.open(path) as image:
                assert min(image.size) > 700
                assert len(np.unique(np.asarray(image.convert("L")))) > 30
    assert re.search(rf"written: {len(expected) + 3} files in first$", printed, re.MULTILINE)
    assert "--object" not in printed


def check_bytes(first: Path, second: Path) -> None:
    """Both runs write the same figures, and the same numbers but of the object of the first."""
    for name in NAMES[:FLAT]:
        for end in (".svg", ".png"):
            path = f"{name}{end}"
            assert (first / path).read_bytes() == (second / path).read_bytes(), path
    one, other = ((folder / "numbers.md").read_text() for folder in (first, second))
    one, other = ([row for row in page.splitlines() if row[:5] != "| box"] for page in (one, other))
    assert one == other


def check_pictures(first: Path, second: Path, printed: str, without: str) -> None:
    """Without OpenGL everything but the pictures of surfaces is drawn."""
    assert "not available, so surface_sphere, surface_box, surface_cylinder show" in without
    assert "--object FILE" in without
    for solid in ("sphere", "box", "cylinder"):
        svg = (second / f"surface_{solid}.svg").read_text()
        assert "<image" not in svg
        assert f"<!-- {solid}" in svg
    if can_render():
        assert "OpenGL" not in printed
        for solid in ("sphere", "box", "cylinder", "object"):
            assert (first / f"surface_{solid}.svg").read_text().count("<image") == 2
