from .noise_settings import NoiseSettings as NoiseSettings
from .perturb import perturb_surface as perturb_surface
from .perturbation import Advice as Advice
from .perturbation import Perturbation as Perturbation
from .perturbation import write_perturbation as write_perturbation
