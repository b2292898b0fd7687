"""The native vector environment: many worlds in one set of arrays."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from passloc_env.actions import finite_actions
from passloc_env.arrays import Array, BoolArray
from passloc_env.batch import Batch
from passloc_env.belief import Belief
from passloc_env.crew import CrewBatch, build_batch
from passloc_env.errors import NotResetError, unknown_name
from passloc_env.rendering.renderer import FRAMES_PER_SECOND, RENDER_MODES, Renderer
from passloc_env.scenario import Scenario
from passloc_env.scenarios import find
from passloc_env.spaces import action_space, observation_space
from passloc_env.vector_info import Partial, masked

_RESET_MASK = "reset_mask"


class LocalisationVectorEnv(VectorEnv[np.ndarray, np.ndarray, np.ndarray]):
    """Many localisation problems stepped together, hundreds of times faster than one by one.

    Semantics, seeds and results are those of :class:`~passloc_env.env.LocalisationEnv`: environment ``i`` of a batch
    meets the same episode, bit for bit, as a single environment reset with ``seed + i``, whatever the batch size.

    Args:
        num_envs: how many.
        scenario: name, Gymnasium id, plain data or a :class:`~passloc_env.Scenario`.
        overrides: scenario fields to change, by dotted name, e.g. ``{"episode.decision_every": 1}``.
        autoreset_mode: ``AutoresetMode`` or its string. ``NextStep`` (default): the step after an episode's end
            ignores the action and returns the new episode's first observation. ``SameStep``: the step that ends an
            episode returns the new one's first observation, the last one is in ``info["final_obs"]`` and
            ``info["final_info"]``. ``Disabled``: finished environments must be reset with
            ``options={"reset_mask": mask}``.
        diagnostics: put truth, estimate, covariance, NEES, relative range error, bound (σ_r in metres), range,
            repairs and measurements gated into ``info``.
        workers: on how many processes to fly, at most; a batch too small for them to pay takes fewer. Results are the
            same to the last bit. A script that asks for more than one must do its work under
            ``if __name__ == "__main__":``, for the others import it. The worlds of a batch on several processes
            cannot be watched, and the environment cannot be copied.
        render_mode: ``rgb_array`` for pictures by :meth:`render`, ``human`` for a window with the first environment. It
            needs ``passloc[render]``, and costs speed.

    Raises:
        ScenarioError: an unknown scenario or field, or an impossible value.
        ValueError: a number of environments or workers below one, an unknown autoreset or render mode, or a render mode
            with several workers.
        DependencyNotInstalled: a render mode without pygame.
        RenderError: a window without a display.
        WorkerError: from any method, when one of the processes has died.
    """

    metadata: dict[str, Any] = {
        "render_modes": list(RENDER_MODES),
        "render_fps": FRAMES_PER_SECOND,
        "autoreset_mode": AutoresetMode.NEXT_STEP,
    }
    # Gymnasium closes what was never finished as well.
    _renderer: Renderer | None = None

    def __init__(
        self,
        num_envs: int = 1,
        scenario: str | Mapping[str, Any] | Scenario = "BearingsOnly",
        *,
        overrides: Mapping[str, Any] | None = None,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        diagnostics: bool = False,
        workers: int = 1,
        render_mode: str | None = None,
    ) -> None:
        for name, number in {"num_envs": num_envs, "workers": workers}.items():
            if isinstance(number, bool) or not isinstance(number, (int, np.integer)) or number < 1:
                raise ValueError(f"{name} = {number!r} is not possible: must be a whole number of at least 1")
        self.scenario = find(scenario).override(overrides or {})
        self.num_envs, self.diagnostics = int(num_envs), diagnostics
        self.metadata = {**self.metadata, "autoreset_mode": _mode(autoreset_mode)}
        self.batch: Batch | CrewBatch = build_batch(self.scenario, self.num_envs, int(workers))
        self.render_mode = render_mode
        if render_mode is not None:
            self._renderer = Renderer(self.batch, render_mode)
        self.single_observation_space = observation_space(self.scenario)
        self.single_action_space = action_space(self.scenario)
        self.observation_space = batch_space(self.single_observation_space, self.num_envs)
        self.action_space = batch_space(self.single_action_space, self.num_envs)
        self._ended: BoolArray = np.zeros(self.num_envs, bool)
        self._started: BoolArray = np.zeros(self.num_envs, bool)

    @property
    def autoreset_mode(self) -> AutoresetMode:
        """How finished environments begin anew."""
        mode: AutoresetMode = self.metadata["autoreset_mode"]
        return mode

    def reset(
        self, *, seed: int | Sequence[int | None] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Begin new episodes.

        Args:
            seed: an int gives environment ``i`` the seed ``seed + i``; a list gives one each; None keeps the present
                generators.
            options: ``{"reset_mask": mask}`` resets only where the boolean mask ``(num_envs,)`` is true; it is left as
                it was given.

        Returns:
            Observations ``(num_envs, f)`` float32 of all environments, and the infos of those that were reset.

        Raises:
            ValueError: a seed list or mask of the wrong length or type, or an unknown option.
        """
        mask = self.reset_mask(options)
        seeds = self._checked_seeds(seed)
        if seed is not None and _is_seed(seed):
            super().reset(seed=int(seed))  # type: ignore[arg-type]
        self.batch.seed_all(mask, seeds)
        self.batch.reset(mask)
        self._started |= mask
        self._ended[mask] = False
        self._show()
        return self.batch.observe(), masked(self.batch.info(self.diagnostics), mask)

    def step(self, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, dict[str, Any]]:
        """One decision each: ``actions (num_envs, a)``, clipped to [-1, 1].

        Returns:
            Observations float32, rewards float64, terminations, truncations, infos; all fresh arrays.

        Raises:
            ActionError: wrong shape, NaN or infinite entries; nothing has changed.
            NotResetError: before the first reset, or, in mode ``Disabled``, for finished environments; nothing has
                changed.
        """
        checked = self._checked_actions(actions)
        next_step = self.autoreset_mode is AutoresetMode.NEXT_STEP
        resetting = self._ended if next_step else np.zeros(self.num_envs, bool)
        same_step = self.autoreset_mode is AutoresetMode.SAME_STEP
        observation, (reward, terminated, truncated), info, last = self.batch.fly(
            checked, resetting, same_step, self.diagnostics
        )
        self._ended = terminated | truncated
        if last is not None:
            info |= _finals(*last, self._ended)
        self._show()
        everywhere = np.ones(self.num_envs, bool)
        return observation, reward, terminated, truncated, masked(info, everywhere)

    def close_extras(self, **kwargs: Any) -> None:
        """Send the workers home and close the window."""
        if self._renderer is not None:
            self._renderer.close()
        batch = getattr(self, "batch", None)
        if isinstance(batch, CrewBatch):
            batch.close()

    def render(self) -> tuple[np.ndarray, ...] | None:
        """With ``rgb_array`` a picture ``(600, 600, 3)`` uint8 of each of the first 16 environments, else None.

        Raises:
            NotResetError: before the first reset.
        """
        if self._renderer is None or self.render_mode == "human":
            return None
        if not self._started.all():
            raise NotResetError("render was called before reset: call reset() first")
        return self._renderer.frames()

    def _show(self) -> None:
        if self._renderer is not None:
            self._renderer.show()

    @property
    def belief(self) -> Belief:
        """What policies may know, batched; see :class:`~passloc_env.belief.Belief`."""
        return self.batch.belief

    def get_state(self) -> dict[str, Any]:
        """A snapshot of every environment and generator, from which :meth:`set_state` continues bit for bit."""
        return {
            "arrays": self.batch.get_arrays(),
            "generators": self.batch.get_generators(),
            "ended": self._ended.copy(),
            "started": self._started.copy(),
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Go back to a snapshot; ValueError, with nothing changed, when it is of another shape."""
        missing = {"arrays", "generators", "ended", "started"} - set(state)
        if missing:
            raise ValueError(f"the state lacks {', '.join(sorted(missing))}")
        if len(state["generators"]) != self.num_envs:
            raise ValueError(f"the state holds {len(state['generators'])} environments, expected {self.num_envs}")
        self.batch.set_arrays(state["arrays"])
        self.batch.set_generators(state["generators"])
        self._ended, self._started = state["ended"].copy(), state["started"].copy()

    def _checked_actions(self, actions: np.ndarray) -> Array:
        checked = finite_actions(actions, (self.num_envs, self.scenario.action_size))
        if not self._started.all():
            raise NotResetError("step was called before reset: call reset() first")
        if self.autoreset_mode is AutoresetMode.DISABLED and self._ended.any():
            ended = np.flatnonzero(self._ended).tolist()
            raise NotResetError(
                f"environments {ended[:8]} have finished: reset them with options={{'reset_mask': mask}}"
            )
        return checked

    def _checked_seeds(self, seed: int | Sequence[int | None] | None) -> list[int | None]:
        if seed is None or _is_seed(seed):
            return [None if seed is None else int(seed) + index for index in range(self.num_envs)]  # type: ignore[arg-type]
        if isinstance(seed, str) or not isinstance(seed, Sequence | np.ndarray):
            raise ValueError(
                f"seed = {seed!r} is not possible: must be a whole number of at least 0, or a list of them"
            )
        if len(seed) != self.num_envs:
            raise ValueError(f"seed has length {len(seed)}, expected one for each of {self.num_envs} environments")
        for index, item in enumerate(seed):
            if item is not None and not _is_seed(item):
                raise ValueError(
                    f"seed {index} = {item!r} is not possible: must be a whole number of at least 0, or None"
                )
        return [None if item is None else int(item) for item in seed]

    def reset_mask(self, options: Mapping[str, Any] | None) -> BoolArray:
        """The environments ``(N,)`` that reset options ask for, all by default; ValueError for bad options."""
        options = options or {}
        for key in options:
            if key != _RESET_MASK:
                raise unknown_name("options", key, [_RESET_MASK], "reset option")
        if _RESET_MASK not in options:
            return np.ones(self.num_envs, bool)
        mask = options[_RESET_MASK]
        if not isinstance(mask, np.ndarray) or mask.dtype != np.bool_ or mask.shape != (self.num_envs,):
            found = f"{mask.dtype} {mask.shape}" if isinstance(mask, np.ndarray) else type(mask).__name__
            raise ValueError(f"reset_mask must be a boolean array of shape ({self.num_envs},), got {found}")
        if not mask.any():
            raise ValueError("reset_mask is false everywhere: it must name at least one environment")
        return mask.copy()


def _finals(observation: np.ndarray, info: dict[str, Any], ended: BoolArray) -> dict[str, Any]:
    """The last observations and infos of the episodes that have just ended."""
    final = np.full(len(ended), None, dtype=object)
    for index in np.flatnonzero(ended):
        final[index] = observation[index]
    ended = ended.copy()
    return {"final_obs": Partial(final, ended), "final_info": Partial(masked(info, ended), ended)}


def _is_seed(seed: object) -> bool:
    return isinstance(seed, (int, np.integer)) and not isinstance(seed, bool) and bool(seed >= 0)


def _mode(mode: AutoresetMode | str) -> AutoresetMode:
    try:
        return AutoresetMode(mode)
    except ValueError:
        known = [m.value for m in AutoresetMode]
        raise unknown_name("autoreset_mode", mode, known, "autoreset mode") from None
