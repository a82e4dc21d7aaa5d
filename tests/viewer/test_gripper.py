"""A gripper in the viewer: panel, colours, files, new searches, and the scene."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from grasp3d import SurfaceLabels, best_grasps, write_ply
from grasp3d.errors import SettingError
from grasp3d.grasps.best import first_vertices
from grasp3d.hand.reach import Reach
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.scene import Scene as HandScene
from grasp3d.hand.scene import scene_settings
from grasp3d.pictures.camera import MOST_BESIDE, View, extents, frame_of, middle_of, view_axes
from grasp3d.pictures.colors import corner_values, ramp_of
from grasp3d.pictures.opengl import new_plotter
from grasp3d.pictures.subject import subject_of
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.settings import Sampling
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.viewer import collection
from grasp3d.viewer import session as sessions
from grasp3d.viewer.collection import collection_of, open_collection, search_grasps
from grasp3d.viewer.controls import CONTROLS, handle_key, offered_paints
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.scene import Scene
from grasp3d.viewer.screenshots import open_renderer
from grasp3d.viewer.session import BEST, Session
from tests.helpers import viewing
from tests.helpers.held_grasps import JAWS, held_box, not_reached, reached
from tests.helpers.viewing import read_subject, ready_session, wait_until_idle
from tests.pictures.test_opengl import needs_opengl

AXES = np.eye(3)


@pytest.fixture(autouse=True)
def at_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Searches begin without a delay."""
    monkeypatch.setattr(sessions, "DELAY", 0.0)


@pytest.fixture
def session() -> Session:
    return ready_session(held_box())


def with_scene(labels: SurfaceLabels, scene: HandScene) -> SurfaceLabels:
    """The same grasps, shown in another scene."""
    return replace(labels, scene=scene)


def held_vertex() -> int:
    return int(reached(held_box())[7])


# Panel


def test_the_panel_lists_what_the_gripper_needs_at_the_clicked_vertex(session: Session) -> None:
    reach, vertex = held_box().reach, held_vertex()
    assert reach is not None
    session.click(vertex)
    seen = session.inspection
    assert seen is not None
    assert seen.held is not None
    assert np.array_equal(seen.held.pose, reach.poses[vertex])
    numbers = dict(seen.numbers)
    assert numbers["approach margin"] == f"{math.degrees(reach.approach_margin[vertex]):.1f}°"
    assert numbers["inserted depth"] == "0 mm"
    assert "gripper jaws and a table" in panel_text(session).facts


def test_the_panel_says_why_a_vertex_is_not_reached(session: Session) -> None:
    session.click(int(not_reached(held_box())[0]), inspect=True)
    seen = session.inspection
    assert seen is not None
    assert seen.held is None
    assert "jaws reaches none of those tested" in seen.reason
    assert "the table is in the way" in seen.reason
    assert len(seen.points) == 1


def test_without_a_gripper_nothing_is_added() -> None:
    session = ready_session(viewing.labels())
    session.click(40)
    assert session.inspection is not None
    assert "approach margin" not in dict(session.inspection.numbers)
    assert not CONTROLS["show_gripper"].shown(session)
    assert "approach_margin" not in offered_paints(session)
    for key in ("j", "t", "6"):
        state = session.state
        assert handle_key(session, key)
        assert "there is no gripper" in session.message
        assert session.state == state


# Colours


def test_colours_of_approach_margins(session: Session) -> None:
    session.change(paint="approach_margin")
    subject, margins = session.subject, held_box().reach.approach_margin  # type: ignore[union-attr]
    assert subject is not None
    ramp = ramp_of(subject, "approach_margin")
    assert ramp is not None
    assert ramp.maximum == pytest.approx(math.degrees(np.nanmax(margins)))
    assert (ramp.unit, ramp.grey) == ("°", "not reached")
    values = corner_values(subject, "approach_margin")
    expected = np.degrees(margins)[subject.mesh.corner_normals.vertices]
    assert np.allclose(values, expected, equal_nan=True)


# New searches


def test_every_new_search_is_for_the_same_gripper_and_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    labels, asked = held_box(), []

    def label(_: object, *__: object, **settings: Any) -> SurfaceLabels:
        asked.append(settings["scene"])
        return replace(labels, sampling=settings["sampling"])

    for module in (collection,):
        monkeypatch.setattr(module, "label_surface", label)
    subject = subject_of(labels)
    search_grasps(subject, subject.labels.model, Sampling())
    collection.search_wider(subject, subject.labels.model, Sampling())
    assert len(asked) == 2
    assert labels.scene is not None
    assert all(one is labels.scene for one in asked)


def test_a_wider_search_keeps_the_poses_of_known_grasps() -> None:
    known = held_box()
    reach = known.reach
    assert reach is not None
    other = {one.name: getattr(reach, one.name)[::-1] for one in fields(Reach)}
    wide = replace(known, reach=Reach(**other))
    found = collection.with_known_grasps(wide, known).reach
    assert found is not None
    for one in fields(Reach):
        assert np.array_equal(getattr(found, one.name), getattr(reach, one.name), equal_nan=True)


def test_fingers_that_the_gripper_cannot_have_are_refused(session: Session) -> None:
    with pytest.raises(SettingError, match="has two fingers, not 3"):
        session.change(fingers=3)
    assert session.state.model.fingers == 2


def test_fixed_fingers_are_not_tested_with_the_gripper(session: Session) -> None:
    session.change(click="fix")
    session.click(held_vertex())
    wait_until_idle(session)
    assert session.scene is not None
    assert any("the gripper is not tested" in note for note in panel_text(session).notes)


# Files


def test_a_labelled_file_brings_its_gripper_and_margins(tmp_path: Path) -> None:
    labels = held_box()
    write_ply(tmp_path / "box.ply", labels)
    subject = read_subject(tmp_path / "box.ply")
    assert subject.labels.scene is not None
    assert labels.scene is not None
    assert labels.reach is not None
    assert subject.labels.scene.hand == JAWS
    assert scene_settings(subject.labels.scene) == scene_settings(labels.scene)
    assert subject.labels.approach_margin is not None
    assert np.allclose(
        subject.labels.approach_margin, labels.reach.approach_margin, atol=1e-6, equal_nan=True
    )
    assert subject.labels.reach is not None
    assert np.array_equal(subject.labels.reach.poses, labels.reach.poses, equal_nan=True)
    best = (best_grasps(one, 2).poses for one in (subject.labels, labels))
    np.testing.assert_allclose(*best, atol=1e-5)


def test_another_gripper_than_in_the_file_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "box.ply"
    write_ply(path, held_box())
    with pytest.raises(SettingError, match="stored labels, which a gripper does not change"):
        open_collection(path, reach=ReachSettings(JAWS))


# Pictures


@pytest.mark.slow
@needs_opengl
def test_a_picture_shows_the_best_grasp_that_is_reached() -> None:
    with open_renderer(collection_of(held_box()), ViewSettings()) as renderer:
        assert renderer.session.state.grasp == 0
        assert renderer.session.inspection is not None
        assert renderer.session.inspection.held is not None
    chosen = ViewSettings(vertex=held_vertex())
    with open_renderer(collection_of(held_box()), chosen) as renderer:
        assert renderer.session.state.vertex == held_vertex()


@pytest.mark.parametrize("labels", [held_box, viewing.labels, viewing.three_fingers, viewing.scan])
def test_the_best_grasps_are_stepped_through(labels: Callable[[], SurfaceLabels]) -> None:
    session, subject = ready_session(labels()), subject_of(labels())
    best = best_grasps(labels(), BEST)
    of_vertices = isinstance(best, GraspTable)
    expected = first_vertices(best).tolist() if of_vertices else list(range(best.size))
    if of_vertices:
        np.testing.assert_allclose(subject.mesh.vertices[expected], best.contacts.points[:, 0])
    assert len(expected) > 1

    def shown() -> int | None:
        seen = session.inspection
        assert seen is not None
        return seen.vertex if of_vertices else (session.state.grasp or 0) % best.size

    seen = []
    for number in range(len(expected) + 1):
        handle_key(session, "b")
        wait_until_idle(session)
        assert session.message == f"{number % len(expected) + 1} of the {len(expected)} best grasps"
        seen.append(shown())
    assert seen == [*expected, expected[0]]
    handle_key(session, "v")
    assert shown() == expected[-1]
    if not of_vertices:
        assert session.inspection is not None
        np.testing.assert_array_equal(session.inspection.points, best.jaws.points[-1])
        session.click(3)
        assert session.state.grasp is None
    session.close()


@contextmanager
def drawn(**settings: Any) -> Iterator[tuple[Session, Scene]]:
    session = Session(collection_of(held_box()), ViewSettings(width=400, height=320, **settings))
    wait_until_idle(session)
    plotter = new_plotter(400, 320)
    try:
        scene = Scene(plotter, legend=False)
        scene.update(session)
        yield session, scene
    finally:
        session.close()
        plotter.close()


@needs_opengl
def test_gripper_and_table_are_drawn_and_can_be_hidden() -> None:
    with drawn() as (session, scene):
        session.change(show_table=False)
        scene.update(session)
        alone = scene.screenshot()
        session.change(show_table=True)
        scene.update(session)
        table = scene.screenshot()
        assert 0.02 < (table != alone).any(axis=2).mean() < 0.9
        session.click(held_vertex())
        wait_until_idle(session)
        scene.update(session)
        both = scene.screenshot()
        grey = np.ptp(both.astype(int), axis=2) < 12
        dark = (both.mean(axis=2) < 225) & grey
        assert dark.mean() > 0.05
        assert (both != table).any(axis=2).mean() > 0.05
        for key in ("j", "t"):
            handle_key(session, key)
        scene.update(session)
        hidden = scene.screenshot()
        grey = np.ptp(hidden.astype(int), axis=2) < 12
        assert ((hidden.mean(axis=2) < 225) & grey).mean() < 0.25 * dark.mean()


@needs_opengl
def test_the_first_gripper_is_framed_in_the_same_direction() -> None:
    with drawn() as (session, scene):
        before = scene.camera.parallel_scale
        direction = np.subtract(scene.camera.position, scene.camera.focal_point)
        session.click(held_vertex())
        wait_until_idle(session)
        scene.update(session)
        after = scene.camera.parallel_scale
        assert before < after < 1.01 * MOST_BESIDE * before
        turned = np.subtract(scene.camera.position, scene.camera.focal_point)
        assert np.allclose(np.cross(direction, turned), 0.0, atol=1e-9)
        session.click(int(reached(held_box())[8]))
        wait_until_idle(session)
        scene.update(session)
        assert scene.camera.parallel_scale == after
        scene.look(session)
        assert scene.camera.parallel_scale == pytest.approx(after, rel=0.3)


@needs_opengl
def test_the_table_is_level_in_the_picture() -> None:
    labels = held_box()
    assert labels.scene is not None
    table = replace(labels.scene.table, normal=np.array([1.0, 0.0, 0.0]))
    tilted = with_scene(labels, replace(labels.scene, table=table))
    session = ready_session(tilted)
    plotter = new_plotter(400, 320)
    try:
        scene = Scene(plotter)
        scene.update(session)
        up = np.array(scene.camera.up)
        toward = np.subtract(scene.camera.position, scene.camera.focal_point)
        assert up @ [1.0, 0.0, 0.0] == pytest.approx(math.cos(View.elevation), abs=1e-6)
        assert toward[0] > 0.0
    finally:
        plotter.close()


numbers = st.floats(-1.0, 1.0, width=32)


@pytest.mark.slow
@given(arrays(float, (6, 3), elements=numbers), arrays(float, (5, 3), elements=numbers))
def test_the_object_stays_in_the_frame_and_does_not_become_tiny(points: Any, beside: Any) -> None:
    points = np.concatenate([points, np.eye(3), -np.eye(3)])
    beside = 40.0 * beside
    frame = frame_of(points, beside, AXES)
    own = np.array(extents(points, middle_of(points, AXES), AXES))
    assert max(frame.reach) <= MOST_BESIDE * own.max() + 1e-9
    inside = np.abs((points - frame.middle)[:, :2]) <= np.array(frame.reach) + 1e-9
    assert inside.all()
    near = frame_of(points, 0.9 * points, AXES)
    assert near.reach == pytest.approx(tuple(own))
    assert frame_of(points, np.empty((0, 3)), AXES).reach == pytest.approx(tuple(own))


@given(arrays(float, 3, elements=numbers))
@example(np.array([1.5e-5, 0.0, -1.0]))
@example(np.array([0.0, 1e-12, -1.0]))
def test_the_picture_is_turned_so_that_a_direction_points_up(up: Any) -> None:
    length = np.linalg.norm(up)
    up = up / length if length > 0.1 else -AXES[2]
    axes = view_axes(View(0.4, 0.5), up)
    assert np.allclose(axes @ axes.T, np.eye(3), atol=1e-6)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    assert axes @ up == pytest.approx(View(0.4, 0.5).axes @ AXES[2], abs=1e-6)
