from .parts import convex_parts as convex_parts
from .pulling import Fate as Fate
from .simulate import simulate_grasps as simulate_grasps
from .simulation_settings import SimulationSettings as SimulationSettings
