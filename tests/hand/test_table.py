"""Tables: below an object as it stands, and in its resting poses."""

import math

import numpy as np
import pytest

from grasp3d import ObjectMesh, Table, load_mesh
from grasp3d.errors import SettingError
from grasp3d.hand.table import Approach
from tests.helpers import shapes


def block(unit: str = "mm") -> ObjectMesh:
    return load_mesh(shapes.box((60.0, 40.0, 20.0)), unit=unit, max_edge=9.0)


@pytest.mark.parametrize(
    ("up", "height"),
    [("z", -0.01), ("-z", -0.01), ("y", -0.02), ("x", -0.03), ((0.0, 0.0, 5.0), -0.01),
     ((0.0, 1.0, 1.0), -0.03 / math.sqrt(2.0))],
)  # fmt: skip
def test_an_object_stands_on_its_lowest_points(up: object, height: float) -> None:
    table = Table.below(block(), up)
    assert np.linalg.norm(table.normal) == pytest.approx(1.0)
    assert table.offset == pytest.approx(height)
    assert table.probability is None
    heights = block().vertices @ table.normal - table.offset
    assert heights.min() == pytest.approx(0.0, abs=1e-9)


def test_vertices_of_no_face_do_not_stand() -> None:
    vertices, faces = shapes.box((60.0, 40.0, 20.0))
    loose = np.concatenate([vertices, [[0.0, 0.0, -500.0]]])
    table = Table.below(load_mesh((loose, faces), unit="mm", max_edge=9.0))
    assert table.offset == pytest.approx(-0.01)


def test_resting_poses_are_on_the_faces_of_a_block_the_largest_first() -> None:
    mesh = block()
    tables = [Table.resting(mesh, number) for number in range(1, 7)]
    chances = [table.probability for table in tables]
    assert chances == sorted(chances, reverse=True)
    assert sum(chances) == pytest.approx(1.0, abs=0.01)
    assert {round(abs(table.offset), 6) for table in tables[:2]} == {0.01}
    assert {round(abs(table.offset), 6) for table in tables[4:]} == {0.03}
    assert np.abs([table.normal for table in tables]).max(axis=1) == pytest.approx(1.0)
    # The chance is the solid angle of the face from the centre of mass, by its closed form.
    x, y, z = 30.0, 20.0, 10.0
    angle = 4.0 * math.atan(x * y / (z * math.sqrt(x * x + y * y + z * z))) / (4.0 * math.pi)
    assert chances[0] == pytest.approx(angle, rel=0.01)
    with pytest.raises(SettingError, match="resting pose must be from 1 to 6"):
        Table.resting(mesh, 7)
    with pytest.raises(SettingError, match="resting pose must be from 1 to 6"):
        Table.resting(mesh, 0)


def test_a_resting_pose_stands_still_far_away_and_in_any_unit() -> None:
    vertices, faces = shapes.lopsided(2)
    near = load_mesh((vertices, faces), unit="m", max_edge=9.0)
    far = load_mesh((1000.0 * vertices + 5000.0, faces), unit="mm", max_edge=9.0)
    one, other = Table.resting(near), Table.resting(far)
    assert other.normal == pytest.approx(one.normal, abs=1e-6)
    assert other.offset == pytest.approx(one.offset + 5.0 * other.normal.sum(), abs=1e-6)
    assert other.probability == pytest.approx(one.probability, abs=1e-6)


@pytest.mark.parametrize("vector", [(0.0, 0.0, 0.0), (0.0, math.nan, 1.0), (0.0, 1.0)])
def test_what_is_no_direction_is_refused(vector: tuple) -> None:
    with pytest.raises(SettingError, match="normal"):
        Table(np.array(vector), 0.0)
    with pytest.raises(SettingError, match="approach direction"):
        Approach(np.array(vector))


def test_directions_have_unit_length_and_are_locked() -> None:
    vector = np.array([0.0, 3.0, 4.0])
    for direction in (Table(vector, 1.0).normal, Approach(vector).direction):
        assert direction.tolist() == pytest.approx([0.0, 0.6, 0.8])
        with pytest.raises(ValueError, match="read-only"):
            direction[0] = 1.0
