from .contacts import SurfaceContacts as SurfaceContacts
from .holding import Holding as Holding
from .labelling import label_surface as label_surface
from .labels import SearchReport as SearchReport
from .labels import SurfaceLabels as SurfaceLabels
from .load_case import LoadCase as LoadCase
from .scanning import scan_surface as scan_surface
from .vertex_grasps import Reason as Reason
