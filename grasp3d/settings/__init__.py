"""Settings of the Python API, the command line and batch runs, as frozen dataclasses.

The docstrings of fields are the helps of the command line. Angles are in radians here; the command
line reads and prints fields of type `Radians` in degrees. Fields of type `Length` hold metres, and
take texts with a unit, such as '80mm'.
"""

from grasp3d.settings.checks import check_choice as check_choice
from grasp3d.settings.checks import whole_number as whole_number
from grasp3d.settings.grasp_model import MAX_FINGERS as MAX_FINGERS
from grasp3d.settings.grasp_model import MAX_SEARCHED_FINGERS as MAX_SEARCHED_FINGERS
from grasp3d.settings.grasp_model import GivenModel as GivenModel
from grasp3d.settings.grasp_model import GraspModel as GraspModel
from grasp3d.settings.grasp_model import with_fingers as with_fingers
from grasp3d.settings.mesh_options import MeshOptions as MeshOptions
from grasp3d.settings.sampling import ANGLE_ROUNDING as ANGLE_ROUNDING
from grasp3d.settings.sampling import GivenSampling as GivenSampling
from grasp3d.settings.sampling import Sampling as Sampling
from grasp3d.settings.sampling import check_search_settings as check_search_settings
from grasp3d.settings.sampling import search_cone as search_cone
from grasp3d.settings.units import DEGREE as DEGREE
from grasp3d.settings.units import Radians as Radians
