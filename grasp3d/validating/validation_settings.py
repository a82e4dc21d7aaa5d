"""Settings of a validation: grid of labels, bins, resamples, seed."""

from dataclasses import dataclass
from typing import Annotated

from grasp3d.errors import SettingError
from grasp3d.settings import DEGREE, GraspModel, Radians, whole_number
from grasp3d.settings.checks import check_range
from grasp3d.settings.parsing import IN_PYTHON

FRICTIONS = (0.3, 0.5, 1.0)
RESOLUTIONS = (0.0, 10.0 * DEGREE, 22.6 * DEGREE, 40.0 * DEGREE)

LEAST_RESAMPLES = 100


@dataclass(frozen=True)
class ValidationSettings:
    """How labels and scores are held against outcomes.

    Attributes:
        frictions: Coefficients of friction of the table of S, M and U, each above 0.
        sensor_resolutions: Sensor resolutions of that table, from 0 to below 180 degrees.
        bins: Bins of the calibration, with about as many grasps each, 2 to 50.
        target: Fraction of the accepted grasps that shall hold, between 0 and 1: the least margin
            from which on this fraction held is reported.
        resamples: Resamples of the bootstrap intervals, at least 100; fewer are drawn for more than
            100,000 grasps.
        seed: Seed of the resamples; the same seed gives the same intervals.
        worst: Largest number of grasps of each kind that contradict their label which are shown,
            beside one for each reason, 0 to 50.

    Example:
        >>> from grasp3d.validating import ValidationSettings
        >>> ValidationSettings(bins=100)
        Traceback (most recent call last):
            ...
        grasp3d.errors.SettingError: bins must be from 2 to 50; got 100
    """

    frictions: Annotated[tuple[float, ...], IN_PYTHON] = FRICTIONS
    sensor_resolutions: Annotated[tuple[Radians, ...], IN_PYTHON] = RESOLUTIONS
    bins: int = 10
    target: float = 0.9
    resamples: int = 1000
    seed: int = 0
    worst: int = 6

    def __post_init__(self) -> None:
        if not self.frictions or not self.sensor_resolutions:
            raise SettingError("frictions and sensor_resolutions need at least one value each")
        for friction in self.frictions:
            for resolution in self.sensor_resolutions:
                GraspModel(friction=friction, sensor_resolution=resolution)  # checks both
        for name, least, most in (("bins", 2, 50), ("worst", 0, 50)):
            check_range(name, getattr(self, name), least, most)
        whole_number("resamples", self.resamples, LEAST_RESAMPLES)
        whole_number("seed", self.seed, 0)
        check_range("target", self.target, 0.0, 1.0, ends="()")
