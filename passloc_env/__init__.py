"""passloc environments: an observer manoeuvres to localise a moving emitter that it can only hear.

Importing this package registers the Gymnasium ids ``passloc/…-v0``.
"""

from passloc_env.env import LocalisationEnv
from passloc_env.errors import ActionError, NotResetError, ScenarioError
from passloc_env.registration import register
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.shadowing import warn_if_shadowed
from passloc_env.spaces import observation_names
from passloc_env.vector_env import LocalisationVectorEnv

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
__version__ = "0.1.0"

register()
warn_if_shadowed()
