from .contacts import SurfaceContacts as SurfaceContacts
from .labelling import label_surface as label_surface
from .labels import SearchReport as SearchReport
from .labels import SurfaceLabels as SurfaceLabels
from .scanning import scan_surface as scan_surface
from .vertex_grasps import Reason as Reason
