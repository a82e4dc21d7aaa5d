# The public names, read by type checkers and, when the package is imported, by Python.
from . import planar as planar
from .batch.batch_settings import BatchSettings as BatchSettings
from .batch.library import label_library as label_library
from .contact.contacts import Contacts as Contacts
from .contact.sensor import Sensor as Sensor
from .diagnosis.diagnosing import check_mesh as check_mesh
from .errors import GraspError as GraspError
from .export import write_fields as write_fields
from .export import write_glb as write_glb
from .export import write_npz as write_npz
from .export import write_ply as write_ply
from .export import write_vtp as write_vtp
from .grasps.distinct import best_grasps as best_grasps
from .grasps.evaluation import evaluate_grasps as evaluate_grasps
from .grasps.reading import read_contacts as read_contacts
from .grasps.writing import write_grasps as write_grasps
from .mesh.object_mesh import ObjectMesh as ObjectMesh
from .mesh.preparing import load_mesh as load_mesh
from .mesh.preparing import mesh_from_arrays as mesh_from_arrays
from .quality.closure import force_closure as force_closure
from .quality.critical_angle import critical_friction_angle as critical_friction_angle
from .quality.ferrari_canny import Epsilon as Epsilon
from .quality.ferrari_canny import epsilon as epsilon
from .quality.ferrari_canny import epsilon_of_wrenches as epsilon_of_wrenches
from .settings import GraspModel as GraspModel
from .settings import MeshOptions as MeshOptions
from .settings import Sampling as Sampling
from .stability.classification import classify as classify
from .stability.label import Label as Label
from .stability.stability import Stability as Stability
from .surface.labelling import label_surface as label_surface
from .surface.labels import SurfaceLabels as SurfaceLabels
from .surface.scanning import scan_surface as scan_surface
from .sweeps import sweep as sweep
from .viewer.view_settings import ViewSettings as ViewSettings

__version__: str
