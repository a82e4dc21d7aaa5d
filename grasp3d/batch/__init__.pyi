from .batch_settings import BatchSettings as BatchSettings
from .batch_settings import ClusterSettings as ClusterSettings
from .library import LibraryLabels as LibraryLabels
from .library import label_library as label_library
from .store import read_summary as read_summary
