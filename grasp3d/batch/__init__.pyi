from .batch_settings import BatchSettings as BatchSettings
from .chunks import Library as Library
from .chunks import open_library as open_library
from .library import label_library as label_library
