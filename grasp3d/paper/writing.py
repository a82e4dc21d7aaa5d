"""Recompute the whole paper into one folder: figures, labelled surfaces, numbers.

Each of Figures 4 to 11 of Wan & Howe 2018 has a function. The scans in space, which the paper
announces as counterparts of its Fig. 7 to 10, have one finger fixed and one scanned on a sphere, a
box, a cylinder and a real object. numbers.md compares the paper's numbers with ours; its text is in
the template of the same name.
"""

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from matplotlib.figure import Figure

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.contact.sensor import Sensor
from grasp3d.errors import OutputError, SettingError
from grasp3d.mesh import ObjectMesh, load_mesh
from grasp3d.paper.curves import (
    ceiling_figure,
    combinations_figure,
    cone_figure,
    curves_figure,
    fractions_figure,
    tips_figure,
)
from grasp3d.pictures.camera import View
from grasp3d.pictures.figures import save_as
from grasp3d.pictures.opengl import can_render
from grasp3d.planar import Circle, Outline, PlanarScan, Square, scan
from grasp3d.settings import DEGREE, GraspModel
from grasp3d.stability.angle_distributions import AngleDistribution, SphereAngles, accuracy_ceiling
from grasp3d.surface.labelling import label_surface, scan_surface
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import Sweep, sweep
from grasp3d.system.context import report_progress, unreported, within
from grasp3d.system.files import atomic_write, check_writable

WIDEST = 120.0 * DEGREE
"""Largest resolution at which fractions are computed [rad]."""
STEPS = 480
"""Number of steps of these resolutions, a quarter of a degree each."""
COLUMNS = 2
"""Most resolutions that fit side by side on a page."""

BELOW = (0.0, 0.0, -1.0)
"""Contact point of the first finger on the solids: the middle underneath, as on the square."""

ELEVATION, ASIDE = 22.0 * DEGREE, 110.0 * DEGREE
"""Camera elevation, and azimuth from the fixed finger, which is then slightly behind the side.
"""
UPRIGHT, AZIMUTH = 0.8, 38.0 * DEGREE
"""Sine of a finger's elevation above which it counts as under or on top of the object, and the
camera's azimuth in that case."""

PIXELS = (720, 720)

PICTURE_EDGE = 1.0 / 100.0
"""Longest edge of a real object's mesh, as a fraction of its size."""
AS_GOOD = 2e-3
"""Difference of critical angles [rad] up to which they count as equally good."""

COMPARED = 24
"""Number of equally good contact points whose scans are compared by the area fraction S."""


@dataclass(frozen=True)
class PaperSettings:
    """Friction, and the resolutions at which curves and pictures are drawn.

    Attributes:
        friction: Coulomb coefficient, above 0.
        sensor_resolutions: One or two resolutions alpha [rad], each with a column in the figures.
    """

    friction: float = 1.0
    sensor_resolutions: tuple[float, ...] = (30.0 * DEGREE, 15.0 * DEGREE)

    def __post_init__(self) -> None:
        if not 1 <= len(self.sensor_resolutions) <= COLUMNS:
            raise SettingError(
                f"give one or two sensor resolutions; got {len(self.sensor_resolutions)}"
            )
        if len(set(self.sensor_resolutions)) < len(self.sensor_resolutions):
            degrees = ", ".join(f"{math.degrees(angle):g}" for angle in self.sensor_resolutions)
            raise SettingError(f"sensor resolutions must be different; got {degrees}")
        _ = self.models

    @property
    def models(self) -> tuple[GraspModel, ...]:
        """The model at each resolution; all have the same friction."""
        return tuple(
            GraspModel(friction=self.friction, sensor_resolution=angle)
            for angle in self.sensor_resolutions
        )

    @property
    def swept(self) -> Floats:
        """Resolutions at which fractions are drawn [rad], shape (k,)."""
        return np.linspace(0.0, WIDEST, STEPS + 1)


@dataclass(frozen=True, eq=False)
class ScannedObject:
    """An object with one finger fixed, labelled at each resolution."""

    name: str
    scans: tuple[SurfaceLabels, ...]
    closed_form: AngleDistribution | None = None


def solids(settings: PaperSettings) -> Iterator[ScannedObject]:
    """Scan the sphere, the box and the cylinder, one after another."""
    sphere = load_mesh(trimesh.creation.icosphere(5), max_edge=4.0)
    box = load_mesh(trimesh.creation.box((2.0, 2.0, 2.0)), max_edge=2.0 / 64.0)
    yield _scanned("sphere", sphere, BELOW, settings, closed_form=SphereAngles())
    yield _scanned("box", box, BELOW, settings)
    yield _scanned("cylinder", _cylinder(), BELOW, settings)


def _cylinder() -> ObjectMesh:
    """A cylinder about x of radius 1 and length 3, without slivers, in sides of 2.5 degrees."""
    across = np.linspace(0.0, 1.0, 21, endpoint=False)
    along = np.linspace(-1.5, 1.5, 64)
    ends = np.full_like(across, 1.5)
    radii = np.concatenate([across, np.ones_like(along), across[::-1]])
    profile = np.column_stack([radii, np.concatenate([-ends, along, ends])])
    cylinder = trimesh.creation.revolve(profile, sections=144)
    cylinder.vertices = cylinder.vertices[:, [2, 0, 1]]
    return load_mesh(cylinder, max_edge=3.0 / 64.0)


def load_object(path: Path) -> ObjectMesh:
    """Read a mesh finely enough for a picture.

    Raises:
        MeshError: The file contains no surface.
    """
    return load_mesh(path, max_edge=PICTURE_EDGE * load_mesh(path).size)


def real_object(mesh: ObjectMesh, name: str, settings: PaperSettings) -> ScannedObject:
    """Scan any object, with the first finger where a two-finger grasp is best.

    Args:
        mesh: Surface of the object.
        name: Name of the object.
        settings: Friction and resolutions.

    Raises:
        SettingError: No grasp was found on the object.
    """
    point = best_contact_point(mesh, settings.models[0])
    with unreported():
        return _scanned(name, mesh, point, settings)


def best_contact_point(mesh: ObjectMesh, model: GraspModel) -> Floats:
    """Find the vertex whose best two-finger grasp tolerates the coarsest sensor, shape (3,).

    Among several vertices that tolerate about equally coarse sensors, some are compared: the one
    with the largest area fraction S for the second finger is chosen.

    Raises:
        SettingError: There is no grasp.
    """
    fine = replace(model, sensor_resolution=0.0)  # smallest search cone
    labels = label_surface(mesh, fine)
    lowest = float(labels.critical_angle.min())
    if math.isinf(lowest):
        raise SettingError(
            f"{mesh.report.source}: no grasp was found that gives the fixed finger's contact point"
        )
    good = np.flatnonzero(labels.critical_angle <= max(lowest, 0.0) + AS_GOOD)
    compared = np.unique(good[np.linspace(0, len(good) - 1, COMPARED).astype(np.int64)])
    with unreported():
        scans = [scan_surface(mesh, model, fixed=point) for point in mesh.vertices[compared]]
    best = int(np.argmax([one.fractions()["S"] for one in scans]))
    return np.array(mesh.vertices[compared[best]])


def view_of(normal: Floats) -> View:
    """Return the view in which the finger is at the side and the opposing contact is visible.

    Args:
        normal: Inward normal at the finger, shape (3,).
    """
    outward = -normal
    if abs(outward[2]) > UPRIGHT:
        return View(AZIMUTH, math.copysign(ELEVATION, -outward[2]))
    return View(math.atan2(outward[1], outward[0]) + ASIDE, ELEVATION)


def object_figure(scanned: ScannedObject, settings: PaperSettings, *, pictures: bool) -> Figure:
    """Draw the labelled surface at each resolution, and the area fractions over all resolutions.

    Args:
        scanned: The object.
        settings: Friction and resolutions.
        pictures: Whether pictures can be rendered; otherwise only the fractions are drawn.
    """
    from grasp3d.pictures.stills import draw_labels

    exact, first = scanned.closed_form, scanned.scans[0].distinct[0]
    view = view_of(scanned.scans[0].partner_normals[first, 0])
    images = [
        draw_labels(scan, view=view, size=PIXELS, fixed=scan.partners[first])
        for scan in scanned.scans
        if pictures
    ]
    return fractions_figure(
        swept(scanned.scans[0].angle_distribution(), scanned.name, settings),
        "area fraction",
        scans=scanned.scans,
        pictures=images,
        closed_form=None if exact is None else swept(exact, scanned.name, settings),
    )


def _scanned(
    name: str, mesh: ObjectMesh, fixed: ArrayLike, settings: PaperSettings, **closed: Any
) -> ScannedObject:
    first, *others = settings.models
    scan = scan_surface(mesh, first, fixed=fixed)
    scans = [scan.relabel(sensor_resolution=model.sensor_resolution) for model in others]
    return ScannedObject(name, (scan, *scans), **closed)


def swept(angles: AngleDistribution, name: str, settings: PaperSettings) -> Sweep:
    """Compute fractions over the resolution, in closed form or from a scan.

    Args:
        angles: An outline, a sphere, or the critical angles of a scan.
        name: Name of the object.
        settings: Friction and resolutions.
    """
    return sweep(
        angles, friction=settings.friction, sensor_resolution=settings.swept, name=name, mode="scan"
    )


CONE_MODEL = GraspModel(friction=1.0, sensor_resolution=30.0 * DEGREE)
"""Model in all drawings of cones, with clearly visible angles."""

TIP = Sensor(receptive_field=4.0, fingertip_radius=10.0)
"""The paper's hemispherical tip with the receptive field that it needs at friction 0.2 [mm]."""


FIGURES: dict[str, Callable[[PaperSettings], Figure]] = {
    "figure_04": lambda _: tips_figure(TIP),
    "figure_05": lambda _: cone_figure(CONE_MODEL),
    "figure_06": lambda _: combinations_figure(CONE_MODEL),
    "figure_07": lambda own: curves_figure(_scans(Circle(), own)),
    "figure_08": lambda own: fractions_figure(swept(Circle(), "circle", own)),
    "figure_09": lambda own: curves_figure(_scans(Square(), own)),
    "figure_10": lambda own: fractions_figure(swept(Square(), "square", own)),
    # The paper's curve is that of the sphere, by area; the others are added for comparison.
    "figure_11": lambda own: ceiling_figure(
        [
            swept(SphereAngles(), "sphere (the paper's)", own),
            *(swept(outline, outline.name, own) for outline in (Circle(), Square())),
        ]
    ),
}
"""Functions that draw the figures, by file name without suffix: tips, cones of one contact and
their combinations; epsilon, then fractions, of the circle and of the square; the best accuracy of a
learned predictor."""


def _scans(outline: Outline, settings: PaperSettings) -> list[PlanarScan]:
    return [scan(outline, model) for model in settings.models]


RADIUS = 10.0
"""Radius of the paper's hemispherical fingertip [mm]."""
FIELDS = (4.0, 9.0)
"""Approximate receptive fields of the paper's two fingertips [mm]."""
OPENINGS = (20.0, 40.0, 80.0)
"""Openings at which the turns of the line are compared [mm]."""

DEGREES = (5.0, 10.0, 15.0, 22.6, 30.0, 45.0, 60.0, 90.0, 100.0, 120.0)
"""Resolutions of the tables [degrees]."""
SLIPPERY = 0.2
"""Friction of the second set of tables, at which the four combinations fail at fine resolutions."""
ARC = 65
"""Number of forces with which a planar cone approximates the arc between its edges."""
FEW_POINTS = 72
"""Number of points at which epsilon at the effective friction is compared."""

COARSE = 22.6 * DEGREE
"""Resolution [rad] at which the paper reads a value from its Fig. 8, at friction 1."""
OUTLINES: dict[str, Outline] = {"circle": Circle(), "square": Square()}
SHAPES: dict[str, AngleDistribution] = {**OUTLINES, "sphere": SphereAngles()}


def numbers_page(settings: PaperSettings, objects: Sequence[ScannedObject]) -> str:
    """Write the page of numbers.

    Args:
        settings: Friction and resolutions.
        objects: Scanned objects in space.
    """
    fingertips = [Sensor.limiting(friction, RADIUS) for friction in (0.5, SLIPPERY)]
    limits = [sensor.resolution for sensor in fingertips]
    before, after, coarse = (
        {name: _fractions(shape, GraspModel(1.0, angle)) for name, shape in SHAPES.items()}
        for angle in (*limits, COARSE)
    )
    remaining = [after[name]["M"] / before[name]["M"] for name in SHAPES]
    slippery = _fractions(SHAPES["sphere"], GraspModel(SLIPPERY, COARSE))
    template = Path(__file__).with_name(NUMBERS).read_text(encoding="utf-8")
    return template.format(
        friction=settings.friction,
        sensors=fingertips,
        limits=np.degrees(limits),
        rounded=Sensor(4.0, RADIUS),
        before={name: _cells(fractions) for name, fractions in before.items()},
        after={name: _cells(fractions) for name, fractions in after.items()},
        coarse={name: _cells(fractions) for name, fractions in coarse.items()},
        slippery=percent(slippery["M"]),
        remaining=[percent(min(remaining)), percent(max(remaining))],
        least=math.tan(COARSE / 2.0),
        most=1.0 / math.tan(COARSE / 2.0),
        at_resolutions=_at_resolutions(settings),
        effective=_effective(settings),
        outlines="\n\n".join(
            _over(outline, friction)
            for friction in dict.fromkeys((settings.friction, SLIPPERY))
            for outline in OUTLINES.values()
        ),
        in_space=_in_space(objects),
        tips=_tips(),
    )


def _at_resolutions(settings: PaperSettings) -> str:
    rows = []
    for one in [scan(outline, model) for model in settings.models for outline in OUTLINES.values()]:
        differing = (one.label_extremes != one.label).sum()
        rows.append(
            {
                "object": one.outline.name,
                "α": _alpha(one.model),
                **_cells(_fractions(one.outline, one.model)),
                "points whose hulls disagree": f"{differing} of {len(one.label)}",
            }
        )
    return _table(rows)


def _effective(settings: PaperSettings) -> str:
    opposite = FEW_POINTS // 2
    rows = [
        {
            "α": _alpha(one.model),
            "forces of a cone": str(one.edges),
            "ε, perceived normals": f"{one.epsilon[opposite]:.4f}",
            "smallest ε over the tilts": f"{one.epsilon_min[opposite]:.4f}",
            "ε at μ_eff": f"{one.epsilon_effective[opposite]:.4f}",
            "largest difference around the circle": (
                f"{np.abs(one.epsilon_effective - one.epsilon_min).max():.1e}"
            ),
        }
        for model in settings.models
        for one in (scan(Circle(), model, points=FEW_POINTS, edges=edges) for edges in (2, ARC))
    ]
    return _table(rows, left=0)


def _over(outline: Outline, friction: float) -> str:
    rows = []
    for degrees in DEGREES:
        model = GraspModel(friction=friction, sensor_resolution=degrees * DEGREE)
        scanned = scan(outline, model)
        four, rings = (
            percent(float(scanned.weights[labels != scanned.label].sum()))
            for labels in (scanned.label_four, scanned.label_extremes)
        )
        parts = scanned.fractions(scanned.label_four).items()
        rows.append(
            {
                "α": _alpha(model),
                **_cells(_fractions(outline, model)),
                **{f"{name}, four": percent(part) for name, part in parts},
                "labels that differ": four,
                "labels that differ, with rings": rings,
            }
        )
    bound = math.degrees(2.0 * math.atan(friction))
    title = f"## The {outline.name} over the resolution, μ = {friction:g}, 2β = {bound:.2f}°"
    return f"{title}\n\n{_table(rows, left=0)}"


def _in_space(objects: Sequence[ScannedObject]) -> str:
    rows = []
    for scanned in objects:
        for result in scanned.scans:
            ours, exact = result.fractions(), scanned.closed_form
            closed = {} if exact is None else _cells(_fractions(exact, result.model))
            rows.append(
                {
                    "object": scanned.name,
                    "α": _alpha(result.model),
                    **_cells(ours),
                    **{f"{name}, closed form": closed.get(name, "–") for name in ours},
                }
            )
    return _table(rows)


def _tips() -> str:
    rows = [
        {
            "fingertip": "flat" if tip.flat else f"round, radius {RADIUS:g} mm",
            "receptive field": f"{tip.receptive_field:g} mm",
            "location ±": f"{tip.location_uncertainty:g} mm",
            "normals, α": f"{math.degrees(tip.resolution):.1f}°",
            **{
                f"line turns, opening {opening:g} mm": f"{tip.line_error(opening) / DEGREE:.1f}°"
                for opening in OPENINGS
            },
            **{
                f"friction above, {opening:g} mm": f"{tip.required_friction_at(opening):.3f}"
                for opening in OPENINGS
            },
        }
        for field in FIELDS
        for tip in (Sensor(field, math.inf), Sensor(field, RADIUS))
    ]
    return _table(rows)


def _fractions(angles: AngleDistribution, model: GraspModel) -> dict[str, float]:
    return angles.fractions(friction=model.friction, sensor_resolution=model.sensor_resolution)


def _table(rows: Sequence[Mapping[str, str]], *, left: int = 1) -> str:
    """Write a table of rows by heading; the first columns are text, the others numbers."""
    rule = [":---"] * left + ["---:"] * (len(rows[0]) - left)
    lines = [list(rows[0]), rule, *(row.values() for row in rows)]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def percent(fraction: float) -> str:
    """Write a fraction in percent with one decimal."""
    return f"{100.0 * fraction + 0.0:.1f} %"


def _cells(fractions: dict[str, float]) -> dict[str, str]:
    """Cells of the fractions S, M and U, and of the accuracy ceiling."""
    parts = {**fractions, "ceiling": accuracy_ceiling(fractions)}
    return {name: percent(part) for name, part in parts.items()}


def _alpha(model: GraspModel) -> str:
    return f"{math.degrees(model.sensor_resolution):.4g}°"


NUMBERS = "numbers.md"
SOLIDS = ("sphere", "box", "cylinder")
OBJECT = "object"
"""Name of a real object in file names."""
SUFFIXES = (".svg", ".png")

SEARCH = 0.3
"""Fraction of the duration taken by the search on a real object, for the progress."""


@dataclass(frozen=True)
class Paper:
    """Files that were written, and what is missing."""

    written: tuple[Path, ...]
    notes: tuple[str, ...]
    """What is missing and why, one sentence each."""


def write_paper(output: Path, settings: PaperSettings, *, object_file: Path | None = None) -> Paper:
    """Recompute Wan & Howe 2018: Fig. 4 to 11, their counterparts in space, and all numbers.

    Files of the same names are replaced atomically; other files in the folder stay unchanged.

    Args:
        output: Folder, created if it is missing.
        settings: Friction and resolutions.
        object_file: A mesh for the counterparts in space.

    Raises:
        SettingError: A setting is out of range, or no grasp was found on the mesh.
        MeshError: The mesh cannot be read.
        OutputError: The folder cannot be written to.
    """
    names = [f"surface_{name}" for name in (*SOLIDS, *[OBJECT] * (object_file is not None))]
    files = [f"{name}{end}" for name in (*FIGURES, *names) for end in SUFFIXES] + [NUMBERS]
    _check(output, files)
    real = list[ScannedObject]()
    if object_file is not None:
        with within(0.0, SEARCH):
            real.append(real_object(load_object(object_file), object_file.stem, settings))
    output.mkdir(parents=True, exist_ok=True)
    with unreported():
        scanned = [*solids(settings), *real]
    pictures = can_render()
    figures = FIGURES | {
        name: partial(object_figure, one, pictures=pictures)
        for name, one in zip(names, scanned, strict=True)
    }
    for number, (name, draw) in enumerate(figures.items(), start=1):
        with unreported():
            figure = draw(settings)
            for end in SUFFIXES:
                save_as(figure, output / f"{name}{end}")
        report_progress(SEARCH + (1.0 - SEARCH) * number / len(figures))
    with atomic_write(output / NUMBERS) as part:
        part.write_text(numbers_page(settings, scanned), encoding="utf-8")
    notes = []
    if not pictures:
        notes.append(
            f"OpenGL is not available, so {', '.join(names)} show the area fractions without the "
            "labelled surfaces; EGL is enough (on Debian: libegl1 libgl1)"
        )
    if object_file is None:
        notes.append("to add a real object give its mesh: --object FILE")
    return Paper(tuple(output / file for file in files), tuple(notes))


def _check(output: Path, files: list[str]) -> None:
    """Check before the work that the folder, or its first existing parent, can be written to."""
    folder = next(one for one in (output, *output.absolute().parents) if one.exists())
    if not folder.is_dir():
        raise OutputError(f"{output}: cannot be made, as {folder} is a file; name another folder")
    for file in files:
        check_writable(folder / file)
