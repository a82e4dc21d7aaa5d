"""Meanings of values that depend on the model."""

from typing import get_args

import pytest

from grasp3d import GraspModel
from grasp3d.settings.grasp_model import MINIMUM, Tilts, epsilon_min_text


def test_every_way_to_compute_the_minimum_has_a_meaning() -> None:
    assert set(MINIMUM) == set(get_args(Tilts))
    assert len(set(MINIMUM.values())) == len(MINIMUM)


@pytest.mark.parametrize(
    ("model", "meaning"),
    [
        (GraspModel(), "smallest over all tilts"),
        (GraspModel(method="extremes"), "smallest over sampled tilts"),
        (GraspModel(torsion_radius=0.01), "lower bound over all tilts"),
    ],
)
def test_the_minimum_is_called_what_it_is(model: GraspModel, meaning: str) -> None:
    assert epsilon_min_text(model) == f"ε_min: {meaning}"
