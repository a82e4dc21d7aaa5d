"""Figure of a scan's labels beside those of its noisy copies."""

import pytest

from grasp3d import MeshOptions
from grasp3d.mesh.noisy_copies import movable_surface
from grasp3d.plots.perturbations import perturbation_figure
from grasp3d.rendering.opengl import can_render
from grasp3d.settings.model_text import error_texts
from grasp3d.validating.perturbing import NoiseSettings
from grasp3d.validating.perturbing.perturb import perturb_surface
from tests.helpers import shapes
from tests.helpers.figures import check_texts


@pytest.mark.slow
@pytest.mark.skipif(not can_render(), reason="needs OpenGL")
def test_the_advised_labels_are_named_with_all_of_their_errors() -> None:
    surface = movable_surface(shapes.lopsided(3), MeshOptions(unit="cm", max_edge=9.0))
    found = perturb_surface(surface, noise=NoiseSettings(noise=0.01, copies=4))
    figure = perturbation_figure(found)
    check_texts(figure)
    titles = [axes.get_title() for axes in figure.axes[:3]]
    normals, locations = error_texts(found.model, "cm")
    assert found.advice.location_error > 0.0
    assert titles[2] == f"with {normals},\n{locations}"
