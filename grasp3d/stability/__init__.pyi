from .angle_distributions import AngleDistribution as AngleDistribution
from .angle_distributions import SphereAngles as SphereAngles
from .angle_distributions import accuracy_ceiling as accuracy_ceiling
from .classification import Stability as Stability
from .classification import classify as classify
from .label import COLORS as COLORS
from .label import Label as Label
