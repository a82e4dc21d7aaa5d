from .causes import Cause as Cause
from .causes import cause_fractions as cause_fractions
from .grasp_facts import facts as facts
from .verdict import LoadVerdict as LoadVerdict
from .verdict import Remedy as Remedy
from .verdict import Verdict as Verdict
from .verdict import verdict_of as verdict_of
