from .axes import AxisValues as AxisValues
from .sweep_result import Sweep as Sweep
from .sweep_result import write_sweeps as write_sweeps
from .sweeping import LocatedGrasps as LocatedGrasps
from .sweeping import mean_sweep as mean_sweep
from .sweeping import sweep as sweep
