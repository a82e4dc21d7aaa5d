"""Settings in their plain form, wherever a function takes them."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import grasp3d
from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.hand.table import Table
from tests.helpers import shapes

BOX = grasp3d.load_mesh(shapes.box((0.06, 0.04, 0.02)), unit="m", max_edge=0.02)
SIDES = [[[0.03, 0.0, 0.0], [-0.03, 0.0, 0.0]], [[0.0, 0.02, 0.005], [0.0, -0.02, 0.005]]]
FROM_ABOVE = np.diag([1.0, -1.0, -1.0, 1.0])
FROM_ABOVE[2, 3] = 0.006


def check_same(one: Any, other: Any) -> None:
    """That two tables are equal, nan where the other one is nan, and their settings are."""
    one, other = one.to_table(), other.to_table()
    assert one.schema.equals(other.schema, check_metadata=True)
    for name in one.column_names:
        np.testing.assert_array_equal(one[name].to_numpy(), other[name].to_numpy(), err_msg=name)


def test_a_surface_is_labelled_with_plain_settings() -> None:
    plain = grasp3d.label_surface(
        BOX, {"friction": "0.4..0.5", "sensor_resolution": 0.2},
        sampling={"max_opening": "50mm"}, hand="franka", table="as-is", load="200g",
        pose_error="1mm",
    )  # fmt: skip
    full = grasp3d.label_surface(
        BOX, grasp3d.GraspModel(friction=(0.4, 0.5), sensor_resolution=0.2),
        sampling=grasp3d.Sampling(max_opening=0.05), hand=grasp3d.read_hand("franka"),
        table=Table.below(BOX), load=grasp3d.Load(mass=0.2), pose_error="1mm",
    )  # fmt: skip
    check_same(plain, full)


def test_lengths_without_a_unit_are_in_that_of_the_meshs_file(tmp_path: Path) -> None:
    shape = shapes.box((60.0, 40.0, 20.0))
    in_mm = grasp3d.load_mesh(shape, unit="mm", max_edge=9.0)
    for text, hand in (
        ("x1,y1,z1,x2,y2,z2\n30,0,0,-30,0,0", None),
        ("x1,y1,z1,x2,y2,z2,unit\n3,0,0,-3,0,0,cm", None),
        ("px,py,pz,qx,qy,qz,qw\n0,0,6,1,0,0,0", "franka"),
        # Of the frame of a palm, whose distance from the TCP is in metres.
        ("px,py,pz,qx,qy,qz,qw,gripper_frame\n0,0,110,1,0,0,0,graspgen", "franka"),
    ):
        (tmp_path / "given.csv").write_text(text)
        found = grasp3d.evaluate_grasps(in_mm, tmp_path / "given.csv", hand=hand)
        np.testing.assert_allclose(found.opening, [0.06], rtol=1e-6)
    unknown = grasp3d.load_mesh(shape, max_edge=90.0)
    pairs = [[[30.0, 0.0, 0.0], [-30.0, 0.0, 0.0]]]
    grasp3d.write_grasps(tmp_path / "plain.csv", grasp3d.evaluate_grasps(unknown, pairs))
    again = grasp3d.evaluate_grasps(unknown, tmp_path / "plain.csv")  # whose column unit is empty
    np.testing.assert_allclose(again.opening, [60.0])
    (tmp_path / "cm.csv").write_text("x1,y1,z1,x2,y2,z2,unit\n3,0,0,-3,0,0,cm")
    with pytest.raises(SettingError, match="the contacts are in cm, but the unit of arrays"):
        grasp3d.evaluate_grasps(unknown, tmp_path / "cm.csv")


def test_settings_of_a_batch_may_be_plain() -> None:
    plain = grasp3d.BatchSettings(
        model={"friction": 0.4}, mesh={"unit": "mm"}, load="0.5kg",
        reach={"hand": "franka", "table": "as-is"},
    )  # type: ignore[arg-type]  # fmt: skip
    assert plain == grasp3d.BatchSettings(
        model=grasp3d.GraspModel(friction=0.4), mesh=grasp3d.MeshOptions(unit="mm"),
        load=grasp3d.Load(mass=0.5),
        reach=ReachSettings(hand=grasp3d.read_hand("franka"), table="as-is"),
    )  # fmt: skip
    none: Any = dict.fromkeys(("model", "sampling", "mesh", "reach", "load"))
    assert grasp3d.BatchSettings(**none) == grasp3d.BatchSettings()


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"sampling": {"points": 8}}, "sampling has no 'points'; known: .*candidates"),
        ({"model": {"mu": 0.4}}, "model has no 'mu'; known: friction, sensor_resolution"),
        ({"model": 0.4}, r"model must be GraspModel\(...\), a dict of its fields; got 0.4"),
        ({"load": [1.0]}, r"load must be Load\(...\), a dict of its fields, its mass; got \[1.0\]"),
        ({"load": "heavy"}, "mass must be a number"),
        ({"hand": "frank"}, "no gripper is called 'frank'"),
        ({"hand": 0.08}, "hand must be a Hand, .*or its file; got 0.08"),
        ({"hand": "franka", "table": "flat"}, "no table is called 'flat'; known: none, as-is, st"),
        ({"hand": "franka", "table": 0.1}, r"table must be Table\(...\), or one of none, as-is"),
        ({"sampling": "80mm"}, r"sampling must be Sampling\(...\), a dict of its fields; got '80m"),
    ],
)
def test_what_has_no_plain_form_is_refused_with_what_would(settings: Any, message: str) -> None:
    with pytest.raises(SettingError, match=message):
        grasp3d.label_surface(BOX, **settings)


def test_a_mask_is_by_letters() -> None:
    labels = grasp3d.label_surface(BOX, {"sensor_resolution": 0.1})
    for letters in ("S", "M", "U", "SM"):
        chosen = {int(grasp3d.Label[letter]) for letter in letters}
        np.testing.assert_array_equal(labels.mask(letters), np.isin(labels.label, [*chosen]))
    for wrong in ("", "s", "stable"):
        with pytest.raises(SettingError, match=f"must be some of S, M and U; got '{wrong}'"):
            labels.mask(wrong)
