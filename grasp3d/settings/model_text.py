"""What a model says about contacts and epsilon, as text."""

import math

from grasp3d.settings import GraspModel
from grasp3d.settings.grasp_model import Tilts
from grasp3d.settings.units import small_length

SAFE_LABELS = "every S and U is correct, an M may be one of them"
"""What labels with a location error mean."""

EPSILON_MIN = "ε_min"
"""Name of the minimum of epsilon."""

MINIMUM: dict[Tilts, str] = {
    "exact": "smallest over all tilts",
    "sampled_tilts": "smallest over sampled tilts",
    "bound": "lower bound over all tilts",
}
"""What the minimum of epsilon is, by how it is computed, where epsilon is named before."""


def epsilon_min_text(model: GraspModel) -> str:
    """Name and meaning of the minimum of epsilon, for a legend.

    Args:
        model: Model of the labels.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.model_text import epsilon_min_text
        >>> print(epsilon_min_text(grasp3d.GraspModel()))
        ε_min: smallest over all tilts
    """
    return f"{EPSILON_MIN}: {MINIMUM[model.tilts]}"


def friction_text(model: GraspModel) -> str:
    """Friction as text: '0.5', or '0.4 to 0.6' for an interval.

    Args:
        model: The model.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.model_text import friction_text
        >>> print(friction_text(grasp3d.GraspModel(friction=(0.4, 0.6))))
        0.4 to 0.6
    """
    return " to ".join(dict.fromkeys(f"{end:.4g}" for end in model.friction_interval))


def location_texts(model: GraspModel, *, metres: bool = True) -> list[str]:
    """The error of contact locations as a text, none where there is no such error.

    Args:
        model: The model.
        metres: Whether its lengths are in metres; otherwise their unit is not known.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.model_text import location_texts
        >>> print(*location_texts(grasp3d.GraspModel(location_error="2mm")))
        locations ± 2 mm
    """
    error = model.location_error
    return [f"locations ± {small_length(error, metres=metres)}"] * (error != 0.0)


def model_line(model: GraspModel, *, metres: bool = True) -> str:
    """Friction, resolution and location error in one line.

    Args:
        model: The model.
        metres: As in `location_texts`.

    Example:
        >>> import grasp3d
        >>> from grasp3d.settings.model_text import model_line
        >>> print(model_line(grasp3d.GraspModel(sensor_resolution=0.2, location_error="1mm")))
        μ 0.5, α 11.46°, locations ± 1 mm
    """
    resolution = f"α {math.degrees(model.sensor_resolution):.4g}°"
    locations = location_texts(model, metres=metres)
    return ", ".join([f"μ {friction_text(model)}", resolution, *locations])
