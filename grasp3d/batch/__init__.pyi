from .batch_settings import BatchSettings as BatchSettings
from .batch_settings import ClusterSettings as ClusterSettings
from .batch_settings import FractionGrid as FractionGrid
from .library import LibraryLabels as LibraryLabels
from .library import label_library as label_library
from .store import read_summary as read_summary
