"""Poses of hands with joints in pictures, in the viewer's session and on its page."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp3d
from grasp3d import GraspModel, Label, Load
from grasp3d.formats import GraspPoses
from grasp3d.grasps import LinkGrasps
from grasp3d.hand.triangles import COLORS, Part
from grasp3d.pictures.marks import MarkedContacts
from grasp3d.pictures.stills import draw_grasps, grasp_figure
from grasp3d.stability.label import COLORS as LABEL_COLORS
from grasp3d.viewer.collection import collection_of_grasps
from tests.helpers import shapes, slider_hand
from tests.helpers.figures import drawn_texts
from tests.helpers.slider_hand import BOX, TOUCHING
from tests.helpers.viewing import inspected, ready_session, wait_until_idle
from tests.pictures.test_opengl import needs_opengl

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
