from .axes import AxisValues as AxisValues
from .sweeping import LocatedGrasps as LocatedGrasps
from .sweeping import Sweep as Sweep
from .sweeping import mean_sweep as mean_sweep
from .sweeping import sweep as sweep
from .sweeping import write_sweeps as write_sweeps
