"""The figure of the best grasps: its text fits, and its views show the fingers."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import GraspModel, Label, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.arrays import locked
from grasp3d.grasps.distinct import best_grasps
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.mesh import ObjectMesh
from grasp3d.plots.grasps import (
    MOST_PICTURES,
    PIXELS,
    draw_grasps,
    grasp_figure,
    views_of,
    views_of_gripper,
)
from grasp3d.plots.painting import PALETTE, paint_labels
from grasp3d.plots.rendering import ARROW, Finger, View, can_render, extent_of, span_of
from grasp3d.plots.rendering import picture as rendered
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.context import running
from tests.helpers import shapes
from tests.helpers.figures import check_texts, drawn_texts
from tests.helpers.held_grasps import held_box, neighbours_grasps, reached
from tests.helpers.vertex_labels import with_arrays
from tests.plots.test_rendering import needs_opengl

BLANK = np.full((8, 8, 3), 255, dtype=np.uint8)


@cache
def labels() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((1.0, 0.7, 0.5)), unit="m", max_edge=0.2)
    return label_surface(mesh, GraspModel(), sampling=Sampling(rays=16))


@cache
def grasps() -> GraspTable:
    return best_grasps(labels(), MOST_PICTURES + 1)


@pytest.mark.slow
@pytest.mark.parametrize("count", [1, 2, 4, 7, MOST_PICTURES])
def test_text_fits_and_vertex_graspsare_numbered(count: int) -> None:
    figure = grasp_figure(labels(), grasps(), [BLANK] * count)
    check_texts(figure)
    texts = [text for text, _ in drawn_texts(figure)]
    titles = [text for text in texts if "varepsilon" in text]
    assert len(titles) == count
    for number, title in enumerate(titles):
        assert rf"\bf{{{number + 1}}}" in title
        angle = math.degrees(grasps().critical_angle[number])
        assert f"{angle:.1f}°" in title
        assert f"{grasps().epsilon[number]:.3f}" in title
    assert any("2 fingers" in text for text in texts)
    assert any("no grasp found" in text for text in texts)


@pytest.mark.slow
def test_a_long_name_and_large_numbers_fit() -> None:
    mesh = labels().mesh
    report = replace(mesh.report, source=f"{'W' * 200} and $1 or $2.ply")
    named = with_arrays(labels(), mesh=replace(mesh, report=report))
    largest = locked(np.full(grasps().size, math.pi / 2.0))
    bad = replace(grasps(), critical_angle=largest, critical_angle_best=largest)
    for count in (1, 9):
        figure = grasp_figure(named, bad, [BLANK] * count)
        check_texts(figure)
        assert any("…WWW" in text and "or \\$2.ply" in text for text, _ in drawn_texts(figure))


def seen_from(mesh: ObjectMesh, points: object) -> NDArray[np.float64]:
    found = evaluate_grasps(mesh, points).contacts
    (view,) = views_of(found, extent_of(mesh.vertices))
    return np.asarray(view.axes @ -found.normals[0].T)


def test_fingers_are_seen_from_their_own_side() -> None:
    """The third axis is toward the camera; fingers are in the picture's plane or before it."""
    box = labels().mesh
    right, up, _ = seen_from(box, [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]])
    assert np.hypot(right, up).min() > 0.9
    for below in (0.25, -0.25):
        three = [[0.5, 0.0, 0.0], [0.0, 0.35, 0.0], [0.1, 0.0, below]]
        _, _, toward = seen_from(box, three)
        assert toward.min() > -1e-9
        assert toward.max() > 0.2


def test_fingers_inside_a_tube_are_seen_through_its_end() -> None:
    mesh = load_mesh(shapes.tube(0.4, 0.5, 0.5), max_edge=9.0)
    found = evaluate_grasps(mesh, [[0.4, 0.0, 0.15], [-0.4, 0.0, 0.15]])
    (view,) = views_of(found.contacts, extent_of(mesh.vertices))
    assert view.elevation > math.radians(30.0)


def test_pictures_of_a_sheet_have_one_scale(monkeypatch: pytest.MonkeyPatch) -> None:
    spans: list[float | None] = []

    def noted(*_: object, span: float | None = None, **__: object) -> NDArray[np.uint8]:
        spans.append(span)
        return BLANK

    monkeypatch.setattr("grasp3d.plots.grasps.paint_labels", noted)
    points = [[[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]], [[0.0, 0.0, 0.25], [0.0, 0.0, -0.25]]]
    mesh = labels().mesh
    given = evaluate_grasps(mesh, points)
    draw_grasps(labels(), given)
    own = [
        span_of(
            mesh.vertices, view, PIXELS, [Finger(*one) for one in zip(points, normals, strict=True)]
        )
        for view, points, normals in zip(
            views_of(given.contacts, extent_of(mesh.vertices)),
            given.contacts.points, given.contacts.normals, strict=True,
        )
    ]  # fmt: skip
    assert own[0] != own[1]
    assert spans == [max(own)] * 2


@pytest.mark.slow
@needs_opengl
def test_contacts_are_visible_and_the_scale_is_the_given_one() -> None:
    mesh = load_mesh(shapes.box((1.0, 1.0, 1.0)), max_edge=9.0)
    finger = Finger(np.array([0.0, 0.0, 0.5]), np.array([0.0, 0.0, -1.0]))
    green = np.tile(PALETTE[2], (len(mesh.vertices), 1))
    size, view = (300, 300), View(0.3, math.radians(60.0))
    for span in (3.0, 6.0):
        image = rendered(
            mesh.vertices, mesh.faces, green, view=view, size=size, fingers=[finger], span=span
        ).astype(int)
        surface = np.abs(image - PALETTE[2]).max(axis=2) < 130
        surface &= image.max(axis=2) - image.min(axis=2) > 60
        width = np.ptp(np.flatnonzero(surface.any(axis=0)))
        across = np.ptp(mesh.vertices @ view.axes[0])
        assert width == pytest.approx(300.0 * across / span, rel=0.03)
    large, span = (900, 900), 2.0
    image = rendered(
        mesh.vertices, mesh.faces, green, view=view, size=large, fingers=[finger], span=span
    )
    tail = finger.point - ARROW * extent_of(mesh.vertices) * finger.normal
    seen = np.concatenate([mesh.vertices, [tail]]) @ view.axes.T
    middle = 0.5 * (seen.min(axis=0) + seen.max(axis=0))
    x, y, _ = 900.0 / span * (view.axes @ finger.point - middle)
    column, row = round(450.0 + x), round(450.0 - y)
    near = image[row - 25 : row + 26, column - 25 : column + 26].astype(int)
    assert (near.max(axis=2) < 60).sum() > 300  # the ball
    assert (near.min(axis=2) > 240).sum() >= 5  # what is outside the surface of its white rim


@pytest.mark.slow
@needs_opengl
def test_every_grasp_is_drawn_with_its_fingers() -> None:
    progress: list[float] = []
    few = best_grasps(labels(), 2)
    pictures = running(progress=progress.append)(draw_grasps)(labels(), few)
    assert can_render()
    assert progress == [0.5, 1.0]
    assert [picture.shape for picture in pictures] == [(PIXELS[1], PIXELS[0], 3)] * 2
    (view, *_) = views_of(few.contacts, extent_of(labels().mesh.vertices))
    bare = paint_labels(labels(), view=view, size=PIXELS)
    for picture in (bare, *pictures):
        assert (np.abs(picture - PALETTE[2].astype(int)).max(axis=2) < 60).mean() > 0.02
    dark = [(picture.max(axis=2) < 60).mean() for picture in (bare, *pictures)]
    assert dark[0] < 0.001
    assert min(dark[1:]) > 0.003


COUNT = 2


@needs_opengl
@pytest.mark.slow
def test_the_gripper_is_drawn_at_each_grasp() -> None:
    labels = held_box()
    grasps = neighbours_grasps(labels, int(reached(labels)[7]), COUNT)
    pictures = draw_grasps(labels, grasps)
    assert len(pictures) == COUNT
    for picture in pictures:
        assert picture.shape == (*PIXELS, 3)
        assert (picture[[0, -1]] == 255).all()
        assert (picture[:, [0, -1]] == 255).all()
        grey = (np.ptp(picture.astype(int), axis=2) < 25) & (picture.mean(axis=2) < 230)
        assert grey.mean() > 0.05
        assert (np.ptp(picture.astype(int), axis=2) > 60).mean() > 0.02
    figure = grasp_figure(labels, grasps, pictures)
    check_texts(figure)
    assert grasps.reach is not None
    texts = [text for text, _ in drawn_texts(figure)]
    assert grasps.closed is not None
    for margin, code in zip(grasps.reach.approach_margin, grasps.closed.label, strict=True):
        assert f"approach ±{math.degrees(margin):.0f}°, closed {Label(code).name}" in texts


@pytest.mark.slow
def test_the_views_show_the_closing_axis_and_the_approach_from_the_side() -> None:
    labels = held_box()
    grasps = neighbours_grasps(labels, int(reached(labels)[7]), COUNT)
    assert grasps.reach is not None
    views = views_of_gripper(grasps.contacts, grasps.reach.poses, 0.045)
    for view, pose in zip(views, grasps.reach.poses, strict=True):
        toward = view.axes[2]
        assert abs(toward @ pose[:3, 0]) < 0.75
        assert abs(toward @ pose[:3, 2]) < 0.9
