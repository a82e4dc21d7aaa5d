from .contacts import Contacts as Contacts
from .contacts import effective_friction as effective_friction
from .sensor import Sensor as Sensor
from .sensor import required_counts as required_counts
from .sensor import resolution_limit as resolution_limit
