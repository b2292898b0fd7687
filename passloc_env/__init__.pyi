from .env import LocalisationEnv
from .errors import ActionError, NotResetError, ScenarioError
from .models import observation_names
from .registration import register
from .scenario import Scenario
from .scenarios import SCENARIOS
from .vector_env import LocalisationVectorEnv

__all__ = [
    "SCENARIOS",
    "ActionError",
    "LocalisationEnv",
    "LocalisationVectorEnv",
    "NotResetError",
    "Scenario",
    "ScenarioError",
    "observation_names",
    "register",
]
__version__: str
