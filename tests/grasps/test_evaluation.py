""""""

import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp3d
from grasp3d import GraspModel, Label, classify, load_mesh
from grasp3d.contact.contacts import Contacts
from grasp3d.describe import verdict_of
from grasp3d.errors import ContactError
from grasp3d.formats import GraspPoses
from grasp3d.grasps.evaluation import OFF_SURFACE, evaluate_grasps
from grasp3d.hand import hand_files
from grasp3d.hand.hand import Hand
from grasp3d.mesh import ObjectMesh
from grasp3d.outcomes import validate_grasps
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system.context import running
from grasp3d.viewer.inspection import inspect_pose
from tests.helpers import shapes
from tests.helpers.pincers import FORMAT, Pincers, above, pincers_of

Floats = NDArray[np.float64]

TRIANGLE = np.array([[math.cos(a), math.sin(a), 0.0] for a in np.radians([0.0, 120.0, 240.0])])
FIELDS = (
    "label", "critical_angle", "critical_angle_best", "max_resolution", "margin", "epsilon",
    "epsilon_min", "epsilon_max", "rank", "opening", "separation",
)  # fmt: skip


@cache
def ball() -> ObjectMesh:
    return load_mesh(shapes.sphere(3), unit="m", max_edge=9.0)


@cache
def blob() -> ObjectMesh:
    return load_mesh(shapes.lopsided(), max_edge=9.0)


@cache
def block() -> ObjectMesh:
    return load_mesh(shapes.box((2.0, 1.0, 0.5)), max_edge=0.25)


def random_contacts(mesh: ObjectMesh, grasps: int, fingers: int, seed: int) -> Floats:
    """Random contacts on a surface, some of them at its vertices."""
    rng = np.random.default_rng(seed)
    corners = mesh.vertices[mesh.faces[rng.integers(len(mesh.faces), size=(grasps, fingers))]]
    weights = rng.dirichlet([0.5, 0.5, 0.5], (grasps, fingers))
    weights[:: max(1, grasps // 8), 0] = (1.0, 0.0, 0.0)
    return np.asarray((weights[..., None, :] @ corners)[..., 0, :])


def assert_equal(one: GraspTable, other: GraspTable, rows: object = slice(None)) -> None:
    for name in FIELDS:
        assert np.array_equal(getattr(one, name)[rows], getattr(other, name), equal_nan=True), name


def test_the_fields_are_those_of_a_single_grasp_at_the_same_contacts() -> None:
    model = GraspModel(0.8, math.radians(20.0), fingers=3)
    grasps = evaluate_grasps(blob(), random_contacts(blob(), 40, 3, 1), model)
    smooth = np.flatnonzero(~grasps.contacts.on_crease.any(axis=1))
    assert len(smooth) > 30
    for row in smooth:
        points = grasps.contacts.points[row] - blob().center_mass
        contacts = Contacts(points, grasps.contacts.normals[row], model.friction)
        angle = critical_friction_angle(contacts)
        assert grasps.critical_angle[row] == pytest.approx(float(angle), abs=2e-4)
        options = EpsilonOptions(torque_scale=blob().torque_scale, rtol=0.01)
        expected = classify(contacts, model.sensor_resolution, options=options)
        if min(abs(angle - model.friction_angle + s * model.tilt) for s in (-1.0, 1.0)) > 1e-3:
            assert grasps.label[row] == expected.label
        assert grasps.epsilon[row] == pytest.approx(float(expected.epsilon), rel=0.03, abs=1e-6)
        assert grasps.epsilon_min[row] == pytest.approx(
            float(expected.epsilon_min), rel=0.03, abs=1e-6
        )
        assert grasps.opening[row] >= grasps.separation[row] > 0.0


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [2, 3, 4])
def test_neither_the_order_of_grasps_nor_that_of_contacts_matters(fingers: int) -> None:
    points = random_contacts(block(), 24, fingers, fingers)
    grasps = evaluate_grasps(block(), points)
    order = np.random.default_rng(7).permutation(len(points))
    assert_equal(grasps, running(threads=2)(evaluate_grasps)(block(), points[order]), order)
    alone = evaluate_grasps(block(), points[3])
    assert_equal(grasps, alone, slice(3, 4))
    swapped = evaluate_grasps(block(), points[:, ::-1])
    assert swapped.critical_angle == pytest.approx(grasps.critical_angle, abs=3e-4)
    assert swapped.critical_angle_best == pytest.approx(grasps.critical_angle_best, abs=3e-4)
    assert swapped.epsilon == pytest.approx(grasps.epsilon, rel=0.02, abs=1e-9)
    assert swapped.opening == pytest.approx(grasps.opening)


@pytest.mark.parametrize("fingers", [2, 3])
def test_moving_object_and_contacts_together_does_not_change_results(fingers: int) -> None:
    vertices, faces = shapes.lopsided()
    points = random_contacts(blob(), 30, fingers, 11)
    rotation, shift, scale = shapes.rotation(4), np.array([3.0, -20.0, 7.0]), 40.0
    moved = load_mesh((scale * vertices @ rotation.T + shift, faces), max_edge=999.0)
    grasps = evaluate_grasps(blob(), points)
    other = evaluate_grasps(moved, scale * points @ rotation.T + shift)
    smooth = ~grasps.contacts.on_crease.any(axis=1)
    assert smooth.sum() > 20
    for name in ("critical_angle", "critical_angle_best", "max_resolution"):
        assert getattr(other, name)[smooth] == pytest.approx(
            getattr(grasps, name)[smooth], abs=2e-4
        )
    assert other.epsilon[smooth] == pytest.approx(grasps.epsilon[smooth], rel=0.02, abs=1e-9)
    assert other.opening == pytest.approx(scale * grasps.opening)
    assert other.separation == pytest.approx(scale * grasps.separation)


def test_contacts_on_creases_may_have_any_normal_between_the_faces() -> None:
    """Two fingers in the middles of opposite sides, then on opposite edges, of a box."""
    sides = [[0.0, 0.5, 0.0], [0.0, -0.5, 0.0]]
    edges = [[0.0, 0.5, 0.25], [0.0, -0.5, -0.25]]
    grasps = evaluate_grasps(block(), [sides, edges])
    assert grasps.contacts.on_crease.tolist() == [[False, False], [True, True]]
    assert grasps.critical_angle == pytest.approx([0.0, math.atan(2.0)])
    assert grasps.critical_angle_best == pytest.approx([0.0, 0.0], abs=1e-9)
    assert grasps.label.tolist() == [2, 1]
    assert grasps.rank.tolist() == [5, 5]


def test_contacts_at_one_point_are_no_grasp() -> None:
    grasps = evaluate_grasps(ball(), np.tile(TRIANGLE[0], (1, 3, 1)))
    assert (grasps.critical_angle[0], grasps.label[0]) == (math.inf, 0)
    assert grasps.max_resolution[0] == grasps.epsilon[0] == grasps.opening[0] == 0.0
    corner = evaluate_grasps(block(), [[[0.5, 0.5, 0.5]] * 2], GraspModel(1.2), max_distance=1.0)
    assert corner.label[0] == 1  # two faces' normals may be opposed by enough friction


def test_contacts_far_from_the_surface_are_refused() -> None:
    limit = OFF_SURFACE * ball().size
    points = np.tile(TRIANGLE, (5, 1, 1))
    points[:, 0] *= 1.0 + 0.9 * limit
    assert evaluate_grasps(ball(), points).distance[:, 0].max() < limit
    points[3, 1] *= 1.0 + 2.0 * limit
    points[4, 2] *= 1000.0
    with pytest.raises(ContactError) as caught:
        evaluate_grasps(ball(), points)
    message = str(caught.value)
    assert message.startswith("grasp 4, contact 2 at (-0.52")
    for part in (
        "41.59 mm",
        "20 mm",
        "2 of 15 contacts",
        "of arrays",
        "its size is 2 m",
        "max_distance",
    ):
        assert part in message
    far = evaluate_grasps(ball(), points, max_distance=1e4).distance[4, 2]
    assert far == pytest.approx(999.0, rel=0.01)
    points = random_contacts(blob(), 30, 3, 5)
    on_it = evaluate_grasps(blob(), points, max_distance=0.0)
    assert on_it.distance.max() < 1e-9 * blob().size  # those very near an edge are moved onto it


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        (np.empty((0, 3, 3)), "no grasps"),
        ([[[1.0, 0.0, 0.0]]], "2 to 32 contacts; got 1"),
        (np.zeros((4, 3, 2)), "shape (b, n, 3)"),
        ([[[1.0, 0.0, 0.0], [0.0, math.nan, 0.0]]], "grasp 1, contact 2"),
    ],
)
def test_invalid_contacts_are_refused_in_one_line(points: object, expected: str) -> None:
    with pytest.raises(ContactError) as caught:
        evaluate_grasps(ball(), points)
    assert expected in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_new_hand_is_evaluated_explained_written_and_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(hand_files.READERS, FORMAT, pincers_of)
    hand = Pincers()
    assert isinstance(hand, Hand)
    box = grasp3d.load_mesh(shapes.box((0.06, 0.04, 0.02)), unit="m")
    poses = GraspPoses(poses=np.array([above(0.0, 0.0), above(0.0, 0.1)]), unit="m")
    load = grasp3d.Load(mass=0.1, task="weight within 0 of -y")
    found = grasp3d.evaluate_grasps(box, poses, hand=hand, load=load)
    assert found.label.tolist() == [Label.S, Label.U]
    assert found.reason.tolist() == ["", "the jaws close on nothing"]
    assert found.critical_angle[0] == pytest.approx(0.0, abs=1e-6)
    assert str(verdict_of(found)).startswith("Surely held by pincers: 1 of 2 grasps")
    assert len(found.held_at(0).triangles(hand).vertices) > 0
    assert dict(inspect_pose(found, found.model).numbers)["pose"] == "grasp_1"
    grasp3d.write_grasps(tmp_path / "found.json", found)
    again = grasp3d.read_grasps(tmp_path / "found.json")
    assert isinstance(again, GraspPoses)
    assert again.hand == hand
    tried = GraspPoses(poses=poses.poses, outcome=[1.0, 0.0], unit="m")
    assert validate_grasps(tried, mesh=box, hand=hand).rates[Label.S].rate == 1.0
