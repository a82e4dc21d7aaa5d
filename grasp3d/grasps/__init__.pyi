from .distinct import best_grasps as best_grasps
from .evaluation import evaluate_grasps as evaluate_grasps
from .reading import read_contacts as read_contacts
from .surface_grasps import SurfaceGrasps as SurfaceGrasps
from .writing import write_grasps as write_grasps
