from .scores import SCORES as SCORES
from .scores import Score as Score
from .success import SuccessRate as SuccessRate
from .validate import validate_grasps as validate_grasps
from .validation import ScoreQuality as ScoreQuality
from .validation import ValidatedFile as ValidatedFile
from .validation import Validation as Validation
from .validation import write_validation as write_validation
