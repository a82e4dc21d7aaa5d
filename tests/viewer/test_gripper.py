"""A gripper in the viewer: panel, colours, files, new searches, and the scene."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp3d
from grasp3d import GraspModel, Label, Load, SurfaceLabels, best_grasps, write_ply
from grasp3d.errors import SettingError
from grasp3d.formats import GraspPoses
from grasp3d.grasps import LinkGrasps
from grasp3d.grasps.best import first_vertices
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import scene_settings
from grasp3d.hand.triangles import COLORS, Part
from grasp3d.pictures.camera import MOST_BESIDE, View
from grasp3d.pictures.marks import MarkedContacts
from grasp3d.pictures.opengl import new_plotter
from grasp3d.pictures.stills import draw_grasps, grasp_figure
from grasp3d.pictures.subject import subject_of
from grasp3d.pictures.view_settings import ViewSettings
from grasp3d.settings import Sampling
from grasp3d.stability.label import COLORS as LABEL_COLORS
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.viewer import collection
from grasp3d.viewer.collection import collection_of, collection_of_grasps
from grasp3d.viewer.controls import handle_key
from grasp3d.viewer.panel_text import panel_text
from grasp3d.viewer.scene import Scene
from grasp3d.viewer.screenshots import open_renderer
from grasp3d.viewer.session import BEST, Session
from tests.helpers import shapes, slider_hand, viewing
from tests.helpers.figures import drawn_texts
from tests.helpers.held_grasps import JAWS, held_box, not_reached, reached
from tests.helpers.slider_hand import BOX, TOUCHING
from tests.helpers.viewing import inspected, read_subject, ready_session, wait_until_idle
from tests.pictures.test_opengl import needs_opengl


@pytest.fixture
def session() -> Session:
    return ready_session(held_box())


def held_vertex() -> int:
    return int(reached(held_box())[7])


def test_the_panel_lists_what_the_gripper_needs_at_the_clicked_vertex(session: Session) -> None:
    reach, vertex = held_box().reach, held_vertex()
    session.click(vertex)
    seen = inspected(session)
    assert np.array_equal(seen.held.pose, reach.poses[vertex])
    numbers = dict(seen.numbers)
    assert numbers["approach margin"] == f"{math.degrees(reach.approach_margin[vertex]):.1f}°"
    assert numbers["inserted depth"] == f"{1000.0 * reach.depth[vertex]:.3g} mm"
    assert "gripper jaws and a table" in panel_text(session).facts
    session.change(paint="approach_margin")
    ramp = panel_text(session).ramp
    assert ramp.maximum == pytest.approx(math.degrees(np.nanmax(reach.approach_margin)))
    assert (ramp.unit, ramp.grey) == ("°", "not reached")
    with pytest.raises(SettingError, match="has two fingers, not 3"):
        session.change(fingers=3)
    assert session.state.model.fingers == 2


def test_the_panel_says_why_a_vertex_is_not_reached(session: Session) -> None:
    session.click(int(not_reached(held_box())[0]), inspect=True)
    seen = inspected(session)
    assert (seen.held, len(seen.points)) == (None, 1)
    assert "jaws reaches none of those tested: " in seen.reason
    session.change(click="fix")
    session.click(held_vertex())
    wait_until_idle(session)
    assert any("the gripper is not tested" in note for note in panel_text(session).notes)


def test_every_new_search_is_for_the_same_gripper_and_table(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    labels, asked = held_box(), []

    def label(_: object, *__: object, **settings: Any) -> SurfaceLabels:
        asked.append(settings["scene"])
        return replace(labels, sampling=settings["sampling"])

    monkeypatch.setattr(collection, "label_surface", label)
    subject = subject_of(labels)
    for search in (collection.search_grasps, collection.search_wider):
        search(subject, subject.labels.model, Sampling())
    assert asked == [labels.scene, labels.scene]


def test_a_wider_search_keeps_the_poses_of_known_grasps() -> None:
    known = held_box()
    other = {one.name: getattr(known.reach, one.name)[::-1] for one in fields(Reach)}
    found = collection.with_known_grasps(replace(known, reach=Reach(**other)), known).reach
    for one in fields(Reach):
        kept = getattr(found, one.name), getattr(known.reach, one.name)
        assert np.array_equal(*kept, equal_nan=True)


def test_a_labelled_file_brings_its_gripper_and_margins(tmp_path: Path) -> None:
    labels = held_box()
    write_ply(tmp_path / "box.ply", labels)
    found = read_subject(tmp_path / "box.ply").labels
    assert found.scene.hand == JAWS
    assert scene_settings(found.scene) == scene_settings(labels.scene)
    margins = found.approach_margin, labels.reach.approach_margin
    assert np.allclose(*margins, atol=1e-6, equal_nan=True)
    assert np.array_equal(found.reach.poses, labels.reach.poses, equal_nan=True)


@pytest.mark.parametrize("labels", [held_box, viewing.three_fingers, viewing.scan])
def test_the_best_grasps_are_stepped_through(labels: Callable[[], SurfaceLabels]) -> None:
    session, best = ready_session(labels()), best_grasps(labels(), BEST)
    of_vertices = isinstance(best, GraspTable)
    expected = first_vertices(best).tolist() if of_vertices else list(range(best.size))
    assert len(expected) > 1

    def shown() -> int | None:
        seen = inspected(session)
        return seen.vertex if of_vertices else (session.state.grasp or 0) % best.size

    for number in range(len(expected) + 1):
        handle_key(session, "b")
        wait_until_idle(session)
        row = number % len(expected)
        assert session.message == f"{row + 1} of the {len(expected)} best grasps"
        assert shown() == expected[row]
    handle_key(session, "v")
    assert shown() == expected[-1]
    if not of_vertices:
        np.testing.assert_array_equal(inspected(session).points, best.jaws.points[-1])
        session.click(3)
        assert session.state.grasp is None
    session.close()


@contextmanager
def drawn(labels: SurfaceLabels) -> Iterator[tuple[Session, Scene]]:
    session = ready_session(labels)
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
    with drawn(held_box()) as (session, scene):

        def grey() -> float:
            """Part of the picture that is as grey and as dark as the gripper."""
            image = scene.screenshot().astype(int)
            return float(((np.ptp(image, axis=2) < 12) & (image.mean(axis=2) < 225)).mean())

        def after(**choices: bool) -> Any:
            session.change(**choices)
            scene.update(session)
            return scene.screenshot()

        alone, table = after(show_table=False), after(show_table=True)
        assert 0.02 < (table != alone).any(axis=2).mean() < 0.9
        session.click(held_vertex())
        wait_until_idle(session)
        assert (after() != table).any(axis=2).mean() > 0.05
        dark = grey()
        assert dark > 0.05
        for key in ("j", "t"):
            handle_key(session, key)
        after()
        assert grey() < 0.25 * dark


@needs_opengl
def test_the_first_gripper_is_framed_in_the_same_direction() -> None:
    with drawn(held_box()) as (session, scene):
        before = scene.camera.parallel_scale
        toward = np.subtract(scene.camera.position, scene.camera.focal_point)
        scales = []
        for vertex in reached(held_box())[7:9].tolist():
            session.click(vertex)
            wait_until_idle(session)
            scene.update(session)
            scales.append(scene.camera.parallel_scale)
        assert before < scales[0] < 1.01 * MOST_BESIDE * before
        assert scales[1] == scales[0]
        turned = np.subtract(scene.camera.position, scene.camera.focal_point)
        assert np.allclose(np.cross(toward, turned), 0.0, atol=1e-9)


@needs_opengl
def test_a_picture_shows_the_best_grasp_that_is_reached_or_the_chosen_one() -> None:
    for settings, grasp in ((ViewSettings(), 0), (ViewSettings(vertex=held_vertex()), None)):
        with open_renderer(collection_of(held_box()), settings) as renderer:
            assert renderer.session.state.grasp == grasp
            assert inspected(renderer.session).held is not None


@needs_opengl
def test_the_table_is_level_in_the_picture() -> None:
    scene = held_box().scene
    table = replace(scene.table, normal=np.array([1.0, 0.0, 0.0]))
    with drawn(replace(held_box(), scene=replace(scene, table=table))) as (_, shown):
        toward = np.subtract(shown.camera.position, shown.camera.focal_point)
        assert shown.camera.up[0] == pytest.approx(math.cos(View.elevation), abs=1e-6)
        assert toward[0] > 0.0


Bytes = NDArray[np.uint8]
FINE = GraspModel(sensor_resolution=math.radians(10.0))


def grasps(folder: Path, *postures: Any, load: Load | None = None, **stated: object) -> LinkGrasps:
    """Four fingers at the sides of a box."""
    values = np.array([np.full(4, one) for one in postures])
    poses = np.tile(np.eye(4), (len(values), 1, 1))
    found = grasp3d.evaluate_grasps(
        grasp3d.load_mesh(shapes.box(BOX), unit="m"),
        GraspPoses(poses=poses, posture=values, unit="m"),
        FINE,
        hand=slider_hand.hand(folder, **stated),
        load=load,
    )
    assert isinstance(found, LinkGrasps)
    return found


def pixels_of(picture: Bytes, color: object) -> int:
    """Pixels of a colour, however the light falls on it."""
    shown, wanted = picture.reshape(-1, 3).astype(float), np.asarray(color, dtype=float)
    brightness = np.linalg.norm(shown, axis=1) / np.linalg.norm(wanted)
    same = shown @ wanted > 0.9995 * np.linalg.norm(shown, axis=1) * np.linalg.norm(wanted)
    return int((same & (brightness > 0.5) & (brightness < 1.01)).sum())


@pytest.mark.slow
@needs_opengl
def test_links_that_touch_have_the_colour_of_the_letter(tmp_path: Path) -> None:
    felt = grasps(tmp_path, [TOUCHING, TOUCHING, TOUCHING, 0.0])
    held = MarkedContacts.of_pose(felt, 0).held
    assert held is not None
    touching = [felt.hand.link_names.index(f"finger_{number}") for number in range(3)]
    color = LABEL_COLORS[Label(int(felt.letter[0]))]
    assert dict(held.colors) == dict.fromkeys(touching, color)
    (picture,) = draw_grasps(felt)
    assert pixels_of(picture, color) > 100
    (away,) = draw_grasps(grasps(tmp_path, 0.0))
    assert not pixels_of(away, color)
    assert pixels_of(away, COLORS[Part.TIP]) > 100


def test_what_the_motors_hold_is_drawn_and_listed(tmp_path: Path) -> None:
    found = grasps(tmp_path, TOUCHING, load=Load(mass=1.5, torque_limits=10.0))
    picture = np.zeros((40, 40, 3), dtype=np.uint8)
    texts = " ".join(text for text, _ in drawn_texts(grasp_figure(found, [picture])))
    payload = found.motors.payload[0]
    assert f"holds {payload:.3g} kg" in texts
    session = ready_session(collection_of_grasps(found))
    numbers = dict(inspected(session).numbers)
    assert numbers["payload"] == f"{payload:.3g} kg"
    assert numbers["limit"].startswith("slide_")
    assert numbers["load"] == f"{1.5 / payload:.3f}"
    assert inspected(session).reason == f"Surely holds {payload:.3g} kg only."
    session.close()


def test_a_session_steps_through_poses_and_evaluates_them_at_another_resolution(
    tmp_path: Path,
) -> None:
    session = ready_session(collection_of_grasps(grasps(tmp_path, TOUCHING, 0.0)))
    shown = inspected(session)
    numbers = dict(shown.numbers)
    assert (shown.code, shown.vertex, len(shown.held.colors)) == (Label.S, None, 4)
    assert shown.reason.startswith("Surely stable")
    assert numbers["links"] == "finger_0 finger_1 finger_2 finger_3"
    assert numbers["β*"].startswith("0.")
    session.change(sensor_resolution=math.radians(70.0))
    assert (inspected(session).code, session.working, session.stale) == (Label.M, None, False)
    session.step_best(1)
    wait_until_idle(session)
    other = inspected(session)
    assert (other.code, other.reason) == (Label.U, "No link within 5 mm of the object.")
    assert (len(other.points), dict(other.held.colors)) == (0, {})
    session.close()
