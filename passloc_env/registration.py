"""The Gymnasium ids, registered on ``import passloc_env``."""

from __future__ import annotations

import gymnasium

from passloc_env.scenarios import SCENARIOS, environment_id


def register() -> None:
    """Register every named scenario; doing it twice changes nothing.

    The environments truncate themselves, so no ``max_episode_steps``: a registered limit would add a wrapper that
    ignores an overridden episode.
    """
    for name in SCENARIOS:
        identifier = environment_id(name)
        if identifier not in gymnasium.registry:
            gymnasium.register(
                id=identifier,
                entry_point="passloc_env.env:LocalisationEnv",
                vector_entry_point="passloc_env.vector_env:LocalisationVectorEnv",
                kwargs={"scenario": name},
            )
