"""Meanings of values that depend on the model, as tables, pages and windows state them."""

from grasp3d.settings import GraspModel
from grasp3d.settings.grasp_model import Tilts

SAFE_LABELS = "every S and U is correct, an M may be one of them"
"""What labels mean whose `certainty` is 'safe'."""

EPSILON_MIN = "ε_min"
"""Name of the minimum of epsilon."""

MINIMUM: dict[Tilts, str] = {
    "exact": "smallest over all tilts",
    "effective_friction": "at the effective friction",
    "sampled_tilts": "smallest over sampled tilts",
    "bound": "lower bound over all uncertainties",
}
"""What the minimum of epsilon is, by how it is computed, where epsilon is named before."""

_LEGENDS: dict[Tilts, str] = {
    "exact": "smallest epsilon over the tilts",
    "effective_friction": "epsilon at the effective friction",
    "sampled_tilts": "smallest epsilon over sampled tilts",
    "bound": "lower bound of epsilon over all uncertainties",
}
"""The same with its name."""


def epsilon_min_text(model: GraspModel) -> str:
    """Name and meaning of the minimum of epsilon, for a legend.

    Args:
        model: Model of the labels.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.meanings import epsilon_min_text
        >>> print(epsilon_min_text(grasp3d.GraspModel(location_error=0.001)))
        ε_min: lower bound of epsilon over all uncertainties
    """
    return f"{EPSILON_MIN}: {_LEGENDS[model.tilts]}"
