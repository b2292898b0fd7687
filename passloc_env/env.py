"""The Gymnasium environment: one world, the N = 1 view of the vector environment."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import gymnasium
import numpy as np
from gymnasium.vector import AutoresetMode

from passloc_env.actions import finite_actions
from passloc_env.batch import Batch
from passloc_env.belief import Belief
from passloc_env.errors import NotResetError
from passloc_env.rendering.renderer import FRAMES_PER_SECOND, RENDER_MODES
from passloc_env.scenario import Scenario
from passloc_env.vector_env import LocalisationVectorEnv


class LocalisationEnv(gymnasium.Env[np.ndarray, np.ndarray]):
    """An observer manoeuvres to localise a moving emitter that it can only hear.

    ## Description

    An emitter moves; an observer measures bearings (and, by scenario, Doppler) and a tracker inside the environment
    turns them into a belief. From most paths the range stays unknown however long one listens: only the observer's own
    manoeuvres make it observable. The agent decides how to move, seeing the tracker's belief and never the truth.

    Nothing raises inside an episode: a diverging tracker is repaired, counted (``info["repairs"]``) and, when its error
    exceeds ``episode.lost_error``, ends the episode as lost.

    ## Action Space

    ``Box(-1, 1, (a,), float32)``, by default a = 1. With ``control="heading"`` (default) the action times π is a
    heading set-point relative to the *believed* line of sight: 0 flies at the emitter, ±0.5 across it, ±1 away. A
    turn-limited autopilot flies it until the next decision. With ``control="turn_rate"`` the action times the maximum
    rate is the turn rate, positive to starboard. Actions beyond ±1 are clipped.

    ## Observation Space

    ``Box(-10, 10, (f,), float32)``: the belief in the frame of its own line of sight. For a planar position-velocity
    state and one platform f = 17:

    | Index | Feature | Scale |
    |---|---|---|
    | 0 | ln of the believed range | in units of ``observation.range_scale`` |
    | 1–2 | own velocity along and across the line of sight | ``observation.speed_scale`` |
    | 3–4 | believed emitter velocity along and across | ``observation.speed_scale`` |
    | 5–8 | ln of the standard deviations: position along, across, velocity along, across | range; speed scale |
    | 9–14 | correlations of the posterior, row by row below the diagonal | |
    | 15 | time left, as a share of the episode | |
    | 16 | last action | |

    ``passloc_env.observation_names(env.unwrapped.scenario)`` names every entry of any scenario.

    ## Rewards

    The mean over the decision's sensor steps of ``Σ weight · term``; the terms are ``range_bound`` (1.0), ``gram_gain``
    (0.05), ``tracking_error`` (0.1) and ``keep_out`` (1.0) by default, each evaluated on the *true* geometry and error.
    ``info["reward_terms"]`` carries every unweighted mean by name.

    ## Starting State

    Emitter and observer start as the scenario's distributions say; the first measurement builds the prior. The same
    seed gives the same episode, alone or in a batch, to the last bit.

    ## Episode End

    *Terminated*: the true range has been below ``episode.min_range``, or the track is lost (both only while
    ``episode.early_end``). *Truncated*: ``episode.steps`` sensor steps have passed. ``info["violated"]`` tells whether
    the range was below the minimum at any sensor step of the decision.

    ## Arguments

    * ``scenario``: name, Gymnasium id, plain data or a ``Scenario``.
    * ``overrides``: scenario fields to change, by dotted name:
      ``{"episode.decision_every": 1, "sensors.0.sigma": 0.01}``.
    * ``diagnostics``: put truth, estimate, covariance, NEES, relative range error, bound (σ_r in metres), range,
      repairs and measurements gated into ``info``.
    * ``render_mode``: ``rgb_array`` or ``human``; needs ``passloc[render]``.

    ```python
    import gymnasium, passloc_env

    env = gymnasium.make("passloc/BearingsOnly-v0", overrides={"episode.decision_every": 1})
    ```

    ## Version History

    * v0: first release; frozen once the shipped agents are.

    Raises:
        ScenarioError: an unknown scenario or field, or an impossible value.
    """

    metadata: dict[str, Any] = {"render_modes": list(RENDER_MODES), "render_fps": FRAMES_PER_SECOND}

    def __init__(
        self,
        scenario: str | Mapping[str, Any] | Scenario = "BearingsOnly",
        *,
        overrides: Mapping[str, Any] | None = None,
        diagnostics: bool = False,
        render_mode: str | None = None,
    ) -> None:
        self._batch_of_one = LocalisationVectorEnv(
            1,
            scenario,
            overrides=overrides,
            autoreset_mode=AutoresetMode.DISABLED,
            diagnostics=diagnostics,
            render_mode=render_mode,
        )
        self.render_mode = render_mode
        self.scenario = self._batch_of_one.scenario
        self.observation_space = self._batch_of_one.single_observation_space
        self.action_space = self._batch_of_one.single_action_space

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin a new episode.

        Returns:
            The observation ``(f,)`` and the info.

        Raises:
            ValueError: a bad seed or an unknown option.
        """
        self._batch_of_one.reset_mask(options)
        super().reset(seed=seed)
        self._batch.generators[0] = self.np_random
        observation, info = self._batch_of_one.reset(options=options)
        return observation[0], _first(info)

    def step(self, action: np.ndarray) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:
        """One decision: ``action (a,)``, clipped to [-1, 1].

        Returns:
            Observation ``(f,)``, reward, terminated, truncated, info; all fresh objects.

        Raises:
            ActionError: wrong shape, NaN or infinite entries; nothing has changed.
            NotResetError: before the first reset or after the episode's end; nothing has changed.
        """
        flown = finite_actions(action, (self.scenario.action_size,))[None]
        try:
            observation, reward, terminated, truncated, info = self._batch_of_one.step(flown)
        except NotResetError:
            raise NotResetError("no episode is running: call reset() first") from None
        return observation[0], float(reward[0]), bool(terminated[0]), bool(truncated[0]), _first(info)

    def render(self) -> np.ndarray | None:
        """With ``rgb_array`` a picture of the episode ``(600, 600, 3)``, uint8; else None.

        Raises:
            NotResetError: before the first reset.
        """
        frames = self._batch_of_one.render()
        return None if frames is None else frames[0]

    def close(self) -> None:
        """Close the window."""
        self._batch_of_one.close()

    @property
    def belief(self) -> Belief:
        """What policies may know; batch axis of length one. See :class:`~passloc_env.belief.Belief`."""
        return self._batch_of_one.belief

    @property
    def _batch(self) -> Batch:
        assert isinstance(self._batch_of_one.batch, Batch)
        return self._batch_of_one.batch

    def get_state(self) -> dict[str, Any]:
        """A snapshot from which :meth:`set_state` continues bit for bit."""
        return self._batch_of_one.get_state()

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go back to a snapshot; ValueError when it is of another shape."""
        self._batch_of_one.set_state(state)
        generator = self._batch.generators[0]
        if generator is not None:
            self.np_random = generator


def _first(info: dict[str, Any]) -> dict[str, Any]:
    """The info of the only environment, as plain numbers and arrays."""
    single: dict[str, Any] = {}
    for key, value in info.items():
        if key.startswith("_"):
            continue
        if isinstance(value, dict):
            single[key] = _first(value)
        else:
            single[key] = value[0].item() if value.ndim == 1 else value[0]
    return single
