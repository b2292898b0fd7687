"""What an agent sees and does, as Gymnasium spaces."""

from __future__ import annotations

import numpy as np
from gymnasium import spaces

from passloc_env.belief import OBSERVATION_LIMIT
from passloc_env.models import observation_names
from passloc_env.scenario import Scenario


def observation_space(scenario: Scenario) -> spaces.Box:
    """The features of the belief, float32, each within ± 10."""
    size = len(observation_names(scenario))
    return spaces.Box(-OBSERVATION_LIMIT, OBSERVATION_LIMIT, (size,), np.float32)


def action_space(scenario: Scenario) -> spaces.Box:
    """The commands of all platforms, float32, each within ± 1."""
    return spaces.Box(-1.0, 1.0, (scenario.action_size,), np.float32)
