"""The names that users rely on, from a mesh to evaluated grasps in a file."""

from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d.quality import Weight
from tests.helpers import shapes


def test_contacts_of_one_grasp() -> None:
    points, normals = [[-1.0, 0, 0], [1.0, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]]
    contacts = grasp3d.Contacts(points, normals, friction=0.5, torsion_radius=0.0)
    found = grasp3d.epsilon(contacts, edges=8, actuation="total", torque_scale=1.0, rtol=1e-3)
    assert found.lower <= found.value <= found.upper
    assert (found.rank, bool(found.closed)) == (5, True)
    assert grasp3d.critical_friction_angle(contacts) == pytest.approx(0.0, abs=1e-3)
    stability = grasp3d.classify(contacts, 0.1, method="exact")
    assert stability.label == grasp3d.Label.S


def test_forces_and_wrenches_of_one_grasp() -> None:
    points, normals = [[-0.03, 0, 0], [0.03, 0, 0]], [[1.0, 0, 0], [-1.0, 0, 0]]
    contacts = grasp3d.Contacts(points, normals, friction=0.5, torsion_radius=0.005)
    weight = Weight(mass=1.0, direction=(0.0, 0.0, -1.0))
    # Each finger carries half of the weight by friction 0.5.
    assert grasp3d.grip_force(contacts, weight).upper == pytest.approx(9.80665)
    assert grasp3d.payload(contacts, weight, 40.0) == pytest.approx(40.0 / 9.80665)
    axes = np.concatenate([np.eye(6), -np.eye(6)])
    assert grasp3d.epsilon_of_wrenches(axes).value == pytest.approx(6**-0.5)


def test_fractions_of_planar_shapes() -> None:
    for fractions in (grasp3d.planar.Circle().fractions, grasp3d.planar.Square().fractions):
        found = fractions(friction=0.5, sensor_resolution=0.3)
        assert set(found) == {"S", "M", "U"}
        assert sum(found.values()) == pytest.approx(1.0)


def test_labels_go_to_a_file_and_back(tmp_path: Path) -> None:
    mesh = grasp3d.load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    labels = grasp3d.label_surface(mesh)
    grasp3d.write_ply(tmp_path / "mug_labeled.ply", labels)
    read = grasp3d.read_labels(tmp_path / "mug_labeled.ply")
    assert isinstance(read, grasp3d.SurfaceLabels)
    np.testing.assert_array_equal(read.label, labels.label)
    assert read.relabel(friction=0.4).fractions() == labels.relabel(friction=0.4).fractions()


def test_labels_of_a_surface() -> None:
    mesh = grasp3d.load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    model = grasp3d.GraspModel(friction=0.5, sensor_resolution=0.3, fingers=2)
    labels = grasp3d.label_surface(mesh, model, sampling=grasp3d.Sampling())
    for name in ("label", "critical_angle", "critical_angle_best", "max_resolution", "epsilon"):
        assert getattr(labels, name).shape == (len(mesh.vertices),)
    assert (labels.reachable, labels.approach, labels.approach_margin) == (None, None, None)
    changed = labels.relabel(friction=0.4, sensor_resolution=0.2)
    assert set(changed.fractions(weights="area")) == {"S", "M", "U"}
    scan = grasp3d.scan_surface(mesh, model, fixed=mesh.vertices[:1])
    assert scan.label.shape == labels.label.shape


@pytest.mark.slow
def test_grasps_of_a_gripper_go_to_a_file_and_back(tmp_path: Path) -> None:
    gripper = grasp3d.ParallelGripper.preset("franka")
    mesh = grasp3d.load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    model = grasp3d.GraspModel(sensor_resolution=0.3)
    table, load = grasp3d.Table.below(mesh), grasp3d.Load(mass=0.2)
    labels = grasp3d.label_surface(mesh, model, hand=gripper, table=table, load=load)
    count = len(mesh.vertices)
    assert labels.reachable.shape == labels.approach_margin.shape == (count,)
    assert labels.approach.shape == (count, 3)
    lengths = np.linalg.norm(labels.approach[labels.reachable], axis=1)
    assert lengths == pytest.approx(1.0)
    assert np.isnan(labels.approach_margin[~labels.reachable]).all()

    grasps = grasp3d.best_grasps(labels, 20)
    assert grasps.poses.shape == (grasps.size, 4, 4)
    assert grasps.opening.shape == grasps.grip_force.shape == grasps.label.shape == (grasps.size,)
    for name in ("mug.csv", "mug.json", "mug.parquet", "mug.yaml"):
        grasp3d.write_grasps(tmp_path / name, grasps)
        given = grasp3d.read_grasps(tmp_path / name, hand=gripper)
        assert given.in_unit("m").poses == pytest.approx(grasps.poses, abs=1e-6)
    found = grasp3d.evaluate_grasps(mesh, given, model, hand=gripper, table=table, load=load)
    assert found.poses.shape == grasps.poses.shape
    np.testing.assert_array_equal(found.label, grasps.label)
    grasp3d.write_grasps(tmp_path / "again.json", found)
    again = grasp3d.read_grasps(tmp_path / "again.json")
    assert again.columns["label"].tolist() == [grasp3d.Label(code).name for code in found.label]


def test_contacts_go_to_a_file_and_back(tmp_path: Path) -> None:
    mesh = grasp3d.load_mesh(shapes.box((0.06, 0.04, 0.08)), unit="m", max_edge=0.02)
    grasps = grasp3d.best_grasps(grasp3d.label_surface(mesh), 3)
    assert (grasps.poses, grasps.grip_force) == (None, None)
    for name in ("mug.csv", "mug.json", "mug.parquet"):
        grasp3d.write_grasps(tmp_path / name, grasps)
        points = grasp3d.read_grasps(tmp_path / name)
        assert points == pytest.approx(grasps.contacts.points)
    np.testing.assert_array_equal(grasp3d.evaluate_grasps(mesh, points).label, grasps.label)
