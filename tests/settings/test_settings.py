""""""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp3d import GraspModel, MeshOptions, Sampling, label_surface, load_mesh
from grasp3d.errors import MeshError, SettingError
from grasp3d.settings import check_search_settings, search_cone
from grasp3d.settings.checks import check_range
from grasp3d.settings.grasp_model import epsilon_min_text
from grasp3d.settings.pose_error import PoseError
from grasp3d.settings.sampling import check_cost, labelling_cost
from tests.helpers import shapes


@pytest.mark.parametrize(
    ("kind", "options", "message"),
    [
        *(
            (GraspModel, {"friction": bad}, "a finite number above 0")
            for bad in (0.0, -1.0, math.inf)
        ),
        *((GraspModel, {"sensor_resolution": bad}, "below 180 degrees") for bad in (-1.0, math.pi)),
        (GraspModel, {"torsion_radius": -1.0}, "a finite length of at least 0; got -1"),
        (GraspModel, {"method": "guess"}, "no method is called 'guess'; known: exact, extremes"),
        (Sampling, {"rays": 3}, "rays must be from 8 to 65536"),
        (Sampling, {"grip": "pinch"}, "known: squeeze, expand, both"),
        (Sampling, {"min_opening": 2.0, "max_opening": 1.0}, "min_opening <= max_opening"),
        (MeshOptions, {"unit": "km"}, "known: m, cm, mm, in"),
        (Sampling, {"candidates": 7}, "candidates must be from 8 to 4096"),
        (Sampling, {"candidate_points": "edges"}, "known: surface, vertices"),
        (Sampling, {"seed": -1}, "seed must be from 0 to 9223372036854775807; got -1"),
        (Sampling, {"search_angle": 2.0}, "at most 90 degrees"),
    ],
)
def test_errors_of_settings_name_valid_values(
    kind: Callable[..., object], options: dict[str, Any], message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        kind(**options)


@pytest.mark.parametrize(
    ("options", "tilts", "rank", "meaning"),
    [
        ({}, "exact", 5, "smallest over all tilts"),
        ({"torsion_radius": 0.01}, "bound", 6, "lower bound over all tilts"),
        ({"method": "extremes"}, "sampled_tilts", 5, "smallest over sampled tilts"),
        (
            {"method": "extremes", "torsion_radius": 0.01},
            "sampled_tilts", 6, "smallest over sampled tilts",
        ),
    ],
)  # fmt: skip
def test_the_model_states_how_epsilon_is_computed(
    options: dict[str, Any], tilts: str, rank: int, meaning: str
) -> None:
    model = GraspModel(**options)
    assert (model.tilts, model.epsilon_rank) == (tilts, rank)
    assert epsilon_min_text(model) == f"ε_min: {meaning}"


def test_the_search_cone_is_the_angle_that_friction_and_resolution_need() -> None:
    model = GraspModel(friction=0.5, sensor_resolution=0.2)
    assert search_cone(model, Sampling()) == pytest.approx(math.atan(0.5) + 0.1)
    assert search_cone(model, Sampling(search_angle=1.2)) == pytest.approx(1.2)
    assert search_cone(GraspModel(friction=10.0, sensor_resolution=1.0), Sampling()) == math.pi / 2
    assert search_cone(model, Sampling(search_angle=0.3)) == pytest.approx(0.3)


def test_a_search_is_for_a_number_of_fingers() -> None:
    for fingers in (2, 3, 5):
        check_search_settings(GraspModel(fingers=fingers), Sampling())
    with pytest.raises(SettingError, match="fingers must be from 2 to 5; got 6"):
        check_search_settings(GraspModel(fingers=6), Sampling())
    check_search_settings(GraspModel(), Sampling(grip="expand"))
    with pytest.raises(SettingError, match="grip expand is for two fingers; got 3"):
        check_search_settings(GraspModel(fingers=3), Sampling(grip="expand"))


@pytest.mark.parametrize(
    ("limits", "ends", "text"),
    [
        ((0.5, 1.0), "[]", "from 0.5 to 1"), ((0.5, 1.0), "(]", "above 0.5 and at most 1"),
        ((0.5, 1.0), "[)", "at least 0.5 and below 1"), ((0.5, 1.0), "()", "above 0.5 and below 1"),
        ((0.5, math.inf), "[]", "at least 0.5"), ((0.5, math.inf), "(]", "above 0.5"),
        ((2, 5), "[]", "from 2 to 5"),
    ],
)  # fmt: skip
def test_a_range_has_the_ends_that_its_message_states(
    limits: tuple[float, float], ends: Any, text: str
) -> None:
    for value, belongs in zip(limits, (ends[0] == "[", ends[1] == "]"), strict=True):
        if belongs:
            check_range("it", value, *limits, ends=ends)
        else:
            with pytest.raises(SettingError, match=f"^it must be {text}; got {value:g}$"):
                check_range("it", value, *limits, ends=ends)
    for value in (math.nan, -math.inf, 1.5 if limits[0] == 2 else 0.25):
        with pytest.raises(SettingError, match=f"^it must be {text}"):
            check_range("it", value, *limits, ends=ends)


def test_whole_limits_are_of_whole_numbers_and_angles_are_shown_in_degrees() -> None:
    with pytest.raises(SettingError, match="it must be from 2 to 5; got 3"):
        check_range("it", 3.0, 2, 5)
    check_range("it", np.int64(3), 2, 5)
    with pytest.raises(SettingError, match=r"from 0 to 90 degrees; got 180 degrees"):
        check_range("it", math.pi, 0.0, math.pi / 2.0, degrees=True)
    with pytest.raises(SettingError, match=r"at least 0\.5 GB; got 0\.25 GB"):
        check_range("it", 0.25, 0.5, unit="GB")


def test_costs_grow_with_vertices_fingers_and_rays() -> None:
    base, double = (labelling_cost(n, GraspModel(), Sampling()) for n in (10_000, 20_000))
    fingers = [labelling_cost(10_000, GraspModel(fingers=n), Sampling()) for n in (2, 3, 4, 5)]
    expand, more_rays, squeeze = (
        labelling_cost(10_000, GraspModel(), Sampling(grip=grip, rays=rays)).seconds
        for grip, rays in (("expand", 64), ("expand", 640), ("squeeze", 640))
    )
    assert double.seconds == pytest.approx(2.0 * base.seconds)
    assert base.memory < double.memory < 2.0 * base.memory
    assert sorted(fingers, key=lambda cost: cost.seconds) == fingers
    assert sorted(fingers, key=lambda cost: cost.memory) == fingers
    assert more_rays == pytest.approx(10.0 * expand)
    assert squeeze == base.seconds  # branch and bound
    half = labelling_cost(10_000, GraspModel(), Sampling(), threads=2)
    assert half.seconds == pytest.approx(base.seconds / 2.0)
    models = GraspModel(), GraspModel(method="extremes"), GraspModel(torsion_radius=0.01)
    more = [labelling_cost(10_000, model, Sampling()).more for model in models]
    assert more == [False, True, True]


def test_a_mesh_that_would_exceed_the_memory_limit_is_refused_with_a_remedy() -> None:
    check_cost(100_000, 2.0, "part.stl", "simplify the mesh")
    with pytest.raises(MeshError, match=r"part.stl: 2,000,000 vertices would take about 3.\d* GB"):
        check_cost(2_000_000, 2.0, "part.stl", "simplify the mesh")


@pytest.mark.slow
def test_refinement_and_more_fingers_may_not_exceed_the_memory_limit() -> None:
    with pytest.raises(MeshError, match=r"longer max_edge .*, or raise max_memory"):
        load_mesh(shapes.box(), max_edge=1e-3, max_memory=0.5)
    mesh = load_mesh(shapes.box(), max_edge=0.005, max_memory=0.8)
    assert len(mesh.vertices) > 200_000
    with pytest.raises(MeshError, match="use a coarser mesh"):
        label_surface(mesh, GraspModel(fingers=5))


LENGTHS = st.just(0.0) | st.floats(1e-9, 0.05)
ANGLES = st.floats(0.0, math.radians(25.0))


@pytest.mark.parametrize(
    ("text", "position", "degrees"),
    [
        ("5mm,3deg", "5 mm", 3.0),
        ("0.002,0", 0.002, 0.0),
        ("0", 0.0, 0.0),
        ("3deg", 0.0, 3.0),
        ("0.1rad", 0.0, math.degrees(0.1)),
    ],
)
def test_texts(text: str, position: object, degrees: float) -> None:
    error = PoseError.of(text)
    assert (str(error.position) if isinstance(position, str) else error.position) == position
    assert math.degrees(error.angle) == pytest.approx(degrees)
    assert PoseError.of(str(error)) == error


@pytest.mark.parametrize("text", ["", "5", "mm", "5mm,3mm", "5mm,3deg,1", "-1mm", "91deg", "nan"])
def test_what_is_no_error_is_refused(text: str) -> None:
    with pytest.raises(SettingError, match="pose error"):
        PoseError.of(text)


@given(LENGTHS, ANGLES)
def test_poses_are_within_the_error_and_the_stated_one_is_first(position: float, a: float) -> None:
    poses = PoseError(position, a).offsets()
    shifts = np.linalg.norm(poses[:, :3, 3], axis=1)
    turns = Rotation.from_matrix(poses[:, :3, :3]).magnitude()
    assert (shifts <= position * (1.0 + 1e-6)).all()
    assert (turns <= a * (1.0 + 1e-6) + 1e-12).all()
    np.testing.assert_array_equal(poses[0], np.eye(4))
    assert len(poses) == (3 if position or a else 1)
    assert shifts.max() == pytest.approx(position)
    assert turns.max() == pytest.approx(a)


def test_tried_poses_are_opposite_and_along_the_pads() -> None:
    one, other = PoseError.of("5mm,3deg").offsets()[1:]
    np.testing.assert_allclose(one[:3, 3], -other[:3, 3])
    np.testing.assert_allclose(one[:3, :3] @ other[:3, :3], np.eye(3), atol=1e-12)
    assert one[0, 3] == 0.0


def test_drawn_errors_have_half_the_error_as_deviation() -> None:
    drawn = PoseError.of("4mm,2deg").draw(40_000, np.random.default_rng(0))
    turns = Rotation.from_matrix(drawn[:, :3, :3]).as_rotvec()
    np.testing.assert_allclose(drawn[:, :3, 3].std(axis=0), 2e-3, rtol=0.02)
    np.testing.assert_allclose(turns.std(axis=0), math.radians(1.0), rtol=0.02)
