"""What is listed of one grasp follows from the declarations of its columns."""

import math

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, Load, best_grasps, label_surface, load_mesh
from grasp3d.describe import facts
from grasp3d.describe.explanations import position_text
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.surface.fields import NONE, OF_ONE, Field

LOAD = Load(mass=0.5, grip_force=20.0)


def test_each_declared_number_that_is_known_is_listed_with_its_unit() -> None:
    mesh = load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit="m", max_edge=0.02)
    labels = label_surface(
        mesh, GraspModel(torsion_radius="3mm"), load=LOAD, hand=ParallelGripper.preset("franka")
    )
    grasps = labels.take(labels.distinct)
    assert grasps.reach is not None
    assert grasps.load_result is not None
    known = np.isfinite(grasps.reach.approach_margin + grasps.load_result.grip_force_largest)
    row = int(np.flatnonzero(known)[0])
    found = facts(grasps, row)
    assert found["opening"] == f"{1e3 * grasps.opening[row]:.3g} mm"
    assert (
        found["force at the worst normals"] == f"{grasps.load_result.grip_force_largest[row]:.3g} N"
    )
    assert found["payload"] == f"{grasps.load_result.payload[row]:.3g} kg"
    assert found["margin"] == f"{math.degrees(grasps.margin[row]):.1f}°"
    assert {"β*", "α*", "ε", "ε_min", "ε_max", "approach margin", "score"} <= found.keys()
    assert NONE not in found.values()


def test_equal_angles_are_listed_once_and_those_of_poses_by_the_same_declarations() -> None:
    mesh = load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
    grasps = best_grasps(label_surface(mesh), 1)
    assert "β* of the best normals" not in facts(grasps, 0)
    held = best_grasps(label_surface(load_mesh(
        trimesh.creation.box([0.08, 0.05, 0.03]), unit="m"
    ), hand=ParallelGripper.preset("franka")), 1)  # fmt: skip
    names = {field.listed or field.heading for field in held.fields}  # type: ignore[union-attr]
    assert set(facts(held, 0)) <= names


def test_names_of_what_is_listed_are_distinct() -> None:
    def name(field: Field) -> str:
        return field.listed or field.heading

    named = [name(field) for field in OF_ONE if name(field)]
    assert len(named) == len(set(named)) > 8


@pytest.mark.parametrize(
    ("unit", "text"), [("m", "(40, 0, -2.5) mm"), (None, "(0.04, 0, -0.0025)")]
)
def test_positions_have_four_digits_and_no_rounding_errors(unit: str | None, text: str) -> None:
    mesh = load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit=unit)  # type: ignore[arg-type]
    assert position_text(np.array([0.04, -1e-17, -0.0025]), mesh) == text
