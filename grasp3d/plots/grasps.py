"""Figure of a surface's best grasps: one small picture each, in the view that shows it best."""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes, Floats
from grasp3d.hand.shapes import hand_triangles
from grasp3d.hand.triangles import Triangles
from grasp3d.mesh.ray_tracing import SurfaceRays
from grasp3d.plots.figures import PAGE, as_text, label_patches, new_figure, show_picture, styled
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.rendering import ARROW, Finger, View, extent_of, span_of
from grasp3d.settings import DEGREE
from grasp3d.settings.lengths import METRES
from grasp3d.settings.model_text import model_line
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.closed_grasps import UNKNOWN
from grasp3d.surface.contacts import GraspContacts
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import report_progress

COLUMNS = 4
HEIGHT, APPROACH = 1.9, 0.25
"""Height of a row of pictures with their titles, and of a line on the approach below [inch]."""
MARGINS = 0.9
"""Height of the headline and the legend [inch]."""
LEAST_WIDTH = 4.6
"""Least width of the figure, which the legend needs [inch]."""

LONGEST = 48
"""Characters of a name in the headline."""

PIXELS = (512, 512)

MOST_PICTURES = 40
"""Most pictures in one figure."""

AZIMUTHS = 24
"""Number of directions about the object that are compared."""

ELEVATIONS = {-25.0 * DEGREE: -0.15, 10.0 * DEGREE: 0.0, 35.0 * DEGREE: 0.1, 60.0 * DEGREE: 0.0}
"""Elevations of the camera that are compared, and their bonus."""

ALONG = (0.06, 0.35, 0.65, 0.95)
"""Fractions of a finger's arrow at which visibility is tested; the first one is the contact's."""

HIDDEN, ENDWISE, OVERLAP = 1.0, 0.4, 0.6
"""Penalties of a view: for hidden parts, for arrows along the line of sight, and for arrows that
overlap."""


BEHIND = (0.05, 0.3, 0.6, 0.9)
"""Fractions of a finger's length behind its contact at which visibility is tested."""

BESIDE = 0.02
"""Distance from the surface of what is tested, in object sizes."""


def draw_grasps(labels: SurfaceLabels, grasps: GraspTable) -> list[Bytes]:
    """Render the labelled surface with the fingers of each grasp, at most `MOST_PICTURES` of them.

    Where a gripper reaches a grasp, it is drawn there instead of arrows. All pictures have the same
    scale, and arrows of the same length.

    Args:
        labels: The labelled surface.
        grasps: Grasps on it.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: OpenGL is not available.
    """
    contacts = grasps.contacts.take(slice(MOST_PICTURES))
    surface = labels.mesh.vertices[labels.mesh.on_surface]
    views = _views(grasps, contacts, extent_of(surface))
    scenes = [
        _scene(grasps, number, view, contacts.points[number], contacts.normals[number])
        for number, view in enumerate(views)
    ]
    span = max(scene.span(surface) for scene in scenes)
    pictures = []
    for number, scene in enumerate(scenes):
        picture = paint_labels(
            labels, view=scene.view, size=PIXELS, fingers=scene.fingers, span=span,
            beside=scene.hand,
        )  # fmt: skip
        pictures.append(picture)
        report_progress((number + 1) / len(views))
    return pictures


def _views(grasps: GraspTable, contacts: GraspContacts, extent: float) -> list[View]:
    """The view of each grasp that is shown, (b, n)."""
    reach, scene, unit = grasps.reach, grasps.scene, grasps.mesh.unit
    if reach is None or scene is None or unit is None or np.isnan(reach.poses).any():
        return views_of(contacts, extent)
    length = scene.hand.finger_length / METRES[unit]
    return views_of_gripper(contacts, reach.poses[: contacts.size], length)


@dataclass(frozen=True, eq=False)
class _Scene:
    """One grasp, and the view of it."""

    view: View
    fingers: list[Finger]
    """Contacts to be marked."""
    hand: Triangles | None

    def span(self, surface: Floats) -> float:
        """Height of a picture that all of it fills, with the points of the surface (V, 3)."""
        if self.hand is None:
            return span_of(surface, self.view, PIXELS, self.fingers)
        both = np.concatenate([surface, self.hand.vertices])
        return span_of(both, self.view, PIXELS)


def _scene(grasps: GraspTable, number: int, view: View, points: Floats, normals: Floats) -> _Scene:
    """What is drawn of one grasp: the gripper if it reaches it, else its contacts (n, 3)."""
    reach, scene, unit = grasps.reach, grasps.scene, grasps.mesh.unit
    if reach is None or scene is None or unit is None or np.isnan(reach.poses[number]).any():
        fingers = [Finger(*pair) for pair in zip(points, normals, strict=True)]
        return _Scene(view, fingers, None)
    pose, opening = reach.poses[number], float(reach.opening[number])
    shape = hand_triangles(scene.hand, opening, pose=pose, unit=unit)
    return _Scene(view, [], shape)


@styled
def grasp_figure(labels: SurfaceLabels, grasps: GraspTable, pictures: list[Bytes]) -> Figure:
    """Lay out the pictures of grasps, numbered from the best.

    Args:
        labels: The labelled surface.
        grasps: The grasps, best first.
        pictures: Pictures of the first grasps, at least one.
    """
    columns = min(len(pictures), COLUMNS)
    rows = math.ceil(len(pictures) / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    height = HEIGHT if grasps.reach is None else HEIGHT + APPROACH
    figure = new_figure(width, rows * height + MARGINS)
    model = labels.model
    figure.suptitle(
        f"{_short(labels.mesh.report.source)}\n"
        f"{model.fingers} fingers, {model_line(model, labels.mesh.unit)}",
        fontsize=8.5,
    )
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(pictures) :]:
        axes.set_axis_off()
    for number, (axes, picture) in enumerate(zip(grid, pictures, strict=False)):
        _show(axes, grasps, number, picture)
    figure.legend(
        handles=label_patches(MEANING[labels.mode]), loc="outside lower center", ncols=len(Label)
    )
    return figure


def _short(name: str) -> str:
    """A file's name as text; its end if it is too long for the headline."""
    text = as_text(name)
    short = text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"
    return short.replace("$", r"\$")


def _show(axes: Axes, grasps: GraspTable, number: int, picture: Bytes) -> None:
    angle = math.degrees(grasps.critical_angle[number])
    label = Label(int(grasps.label[number])).name
    title = (
        rf"$\bf{{{number + 1}}}$  {label}   $\beta^*$ {angle:.1f}°"
        rf"   $\varepsilon$ {grasps.epsilon[number]:.3f}"
    )
    show_picture(axes, picture, title, _approach(grasps, number))


def _approach(grasps: GraspTable, number: int) -> str:
    """The approach margin if a gripper reaches the grasp, and the label after closing if known."""
    margin = math.nan if grasps.reach is None else float(grasps.reach.approach_margin[number])
    if not math.isfinite(margin):
        return ""
    code = UNKNOWN if grasps.closed is None else int(grasps.closed.label[number])
    closed = "" if code == UNKNOWN else f", closed {Label(code).name}"
    return f"approach ±{math.degrees(margin):.0f}°{closed}"


def views_of_gripper(contacts: GraspContacts, poses: Floats, length: float) -> list[View]:
    """Choose for each grasp the view that shows most of a gripper's fingers, side by side.

    Args:
        contacts: The grasps, (b, 2).
        poses: Matrices from the gripper's frame to the mesh's, shape (b, 4, 4).
        length: Length of the fingers, in the mesh's unit.
    """
    mesh = contacts.mesh
    rays = SurfaceRays(mesh.contact_surface, mesh.contact_normals)
    views = []
    for points, normals, pose in zip(contacts.points, contacts.normals, poses, strict=True):
        back = length * np.array(BEHIND)[:, None] * pose[:3, 2]  # (p, 3)
        parts = (points - BESIDE * mesh.size * normals)[:, None] - back  # (2, p, 3)
        views.append(_view_of_fingers(rays, pose, (parts - mesh.center) / mesh.size))
    return views


def _view_of_fingers(rays: SurfaceRays, pose: Floats, parts: Floats) -> View:
    """Choose the view of fingers with some parts (2, p, 3) in the normalised frame."""
    views, bonus = _candidates()
    toward = np.stack([view.axes[2] for view in views])  # (v, 3)
    hidden = _hidden(rays, parts, toward)
    along = np.abs(toward @ pose[:3, :3]) ** 2  # (v, 3), of the closing axis, y and the approach
    behind = np.maximum(-toward @ pose[:3, 2], 0.0)  # there the palm hides the fingers
    endwise = along[:, 0] + 0.5 * along[:, 2] + 2.0 * behind**2
    score = bonus - HIDDEN * hidden - ENDWISE * endwise
    return views[int(np.argmax(score))]


def views_of(contacts: GraspContacts, extent: float) -> list[View]:
    """Choose for each grasp the view that shows most of its fingers, well apart.

    Args:
        contacts: The grasps, (b, n).
        extent: Length that `rendering.picture` scales the fingers' marks by, in the mesh's unit.
    """
    views, bonus = _candidates()
    axes = np.stack([view.axes for view in views])  # (v, 3, 3)
    mesh = contacts.mesh
    rays = SurfaceRays(mesh.contact_surface, mesh.contact_normals)
    best = []
    for points, normals in zip(contacts.points, contacts.normals, strict=True):
        steps = ARROW * extent * np.array(ALONG)[:, None]
        parts = points[:, None] - steps * normals[:, None]  # (n, p, 3)
        hidden = _hidden(rays, (parts - mesh.center) / mesh.size, axes[:, 2])
        endwise = np.abs(axes[:, 2] @ normals.T).mean(axis=1) ** 2
        overlap = _overlap(np.einsum("vij,npj->vnpi", axes[:, :2], parts) / (ARROW * extent))
        score = bonus - HIDDEN * hidden - ENDWISE * endwise - OVERLAP * overlap
        best.append(views[int(np.argmax(score))])
    return best


def _candidates() -> tuple[list[View], Floats]:
    """The views that are compared, and the bonus of each, shape (v,)."""
    azimuths = np.arange(AZIMUTHS) * 2.0 * math.pi / AZIMUTHS
    pairs = list(itertools.product(azimuths, ELEVATIONS))
    views = [View(float(azimuth), elevation) for azimuth, elevation in pairs]
    return views, np.array([ELEVATIONS[elevation] for _, elevation in pairs])


def _hidden(rays: SurfaceRays, parts: Floats, eyes: Floats) -> Floats:
    """How much of parts (n, p, 3), half of it of the first ones, cameras do not see, shape (v,).

    Args:
        rays: The surface.
        parts: What is looked at, in the normalised frame.
        eyes: Directions of the cameras, shape (v, 3).
    """
    shape = (len(eyes), *parts.shape)
    origins = np.broadcast_to(parts, shape).reshape(-1, 3).astype(np.float32)
    toward = np.broadcast_to(eyes[:, None, None], shape).reshape(-1, 3).astype(np.float32)
    visible = rays.hits(origins, toward)["primID"].reshape(shape[:-1]) < 0  # (v, n, p)
    return np.asarray(1.0 - 0.5 * (visible[..., 0] + visible.mean(axis=2)).mean(axis=1))


def _overlap(flat: Floats) -> Floats:
    """Proximity of the nearest two arrows of each view, from 0 to 1, shape (v,).

    Args:
        flat: Points of the arrows in the picture, in units of an arrow, shape (v, n, p, 2).
    """
    nearest = np.full(len(flat), math.inf)
    for one, two in itertools.combinations(range(flat.shape[1]), 2):
        gaps = np.linalg.norm(flat[:, one, :, None] - flat[:, two, None], axis=-1)  # (v, p, p)
        nearest = np.minimum(nearest, gaps.min(axis=(1, 2)))
    return np.clip(1.0 - nearest / 0.5, 0.0, 1.0)
