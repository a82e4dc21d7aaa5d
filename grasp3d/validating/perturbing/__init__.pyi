from .noise_settings import NoiseSettings as NoiseSettings
from .perturb import Advice as Advice
from .perturb import Perturbation as Perturbation
from .perturb import perturb_surface as perturb_surface
from .perturb import write_perturbation as write_perturbation
