"""Estimates of memory and time, and limits checked before labelling."""

import pytest

from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.errors import MeshError
from grasp3d.settings.sampling import check_cost, labelling_cost
from tests.helpers import shapes


def test_costs_grow_with_vertices_fingers_and_rays() -> None:
    base = labelling_cost(10_000, GraspModel(), Sampling())
    double = labelling_cost(20_000, GraspModel(), Sampling())
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


def test_refinement_may_not_exceed_the_memory_limit() -> None:
    with pytest.raises(MeshError, match=r"longer max_edge .*, or raise max_memory"):
        load_mesh(shapes.box(), max_edge=1e-3, max_memory=0.5)


@pytest.mark.slow
def test_more_fingers_may_not_exceed_the_memory_limit() -> None:
    mesh = load_mesh(shapes.box(), max_edge=0.005, max_memory=0.8)
    assert len(mesh.vertices) > 200_000
    with pytest.raises(MeshError, match="use a coarser mesh"):
        label_surface(mesh, GraspModel(fingers=5))
