from .explanations import Cause as Cause
from .explanations import cause_fractions as cause_fractions
from .explanations import facts as facts
from .verdict import LoadVerdict as LoadVerdict
from .verdict import Remedy as Remedy
from .verdict import Verdict as Verdict
from .verdict import verdict_of as verdict_of
