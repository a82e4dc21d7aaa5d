from .npz import write_npz as write_npz
from .parquet import write_fields as write_fields
from .ply import write_ply as write_ply
from .read_labels import read_labels as read_labels
from .vtp import write_vtp as write_vtp
from .writers import write_glb as write_glb
