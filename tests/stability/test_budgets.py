import math

import numpy as np
import pytest

import grasp3d
from grasp3d.stability import margin_budget


def test_the_margin_is_the_sure_angle_minus_the_critical_angle() -> None:
    model = grasp3d.GraspModel(friction=(0.4, 0.6), sensor_resolution=0.2)
    critical = np.array([0.0, 0.1, math.inf])
    budget = margin_budget(model, critical)
    np.testing.assert_allclose(budget["margin"], model.sure_angle - critical)
    assert budget["friction"][0] == pytest.approx(math.atan(0.5) - math.atan(0.4))
    assert budget["sensor resolution"][0] == 0.1
    np.testing.assert_allclose(sum(part[:2] for part in budget.values()), math.atan(0.5))
