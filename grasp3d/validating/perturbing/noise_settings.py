"""Settings of noisy copies of a scan."""

from dataclasses import dataclass
from typing import Annotated

from grasp3d.settings.checks import check_length, check_range, check_seed
from grasp3d.settings.lengths import Length, LengthSettings
from grasp3d.settings.parsing import Main

MAX_COPIES = 10_000


@dataclass(frozen=True)
class NoiseSettings(LengthSettings):
    """The noise of a scan, and how many copies with such noise are made.

    A length is a number in the mesh's unit, or has a unit: '0.5mm', '0.0005 m'.

    Attributes:
        noise: Noise of the scanner: standard deviation of its points' errors along the normals, a
            length; none: estimated from the roughness of the surface.
        correlation: Distance over which the errors of neighbours are alike, a length: the radius of
            a depth camera's filter, the edge of a voxel. The correlation falls to 61 % at this
            distance and to 14 % at twice of it. 0: the errors of neighbours are independent.
        copies: Number of noisy copies, from 2; 200 for numbers that hardly depend on chance.
        level: What is S with the printed errors must be S in at least this fraction of the copies,
            above 0.5 and below 1.
        noise_seed: Seed of the noise; the same seed gives the same copies.

    Example:
        >>> from grasp3d.validating.perturbing import NoiseSettings
        >>> NoiseSettings(noise="0.3mm", correlation="2mm", copies=200).noise
        '0.3 mm'
    """

    noise: Annotated[Length[float | None], Main("noise of the scanner, such as 0.3mm")] = Length(
        None
    )
    correlation: Annotated[Length[float], Main("over which errors are alike")] = Length(0.0)
    copies: Annotated[int, Main("noisy copies")] = 50
    level: float = 0.95
    noise_seed: int = 0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.noise is not None:
            check_length("noise", self.noise, above=True)
        check_length("correlation", self.correlation)
        check_range("copies", self.copies, 2, MAX_COPIES)
        check_range("level", self.level, 0.5, 1.0, ends="()")
        check_seed("noise seed", self.noise_seed)
