"""Saving a training between rollouts, at a chosen interval."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from stable_baselines3.common.callbacks import BaseCallback

from training.checkpoint import Checkpoint
from training.files import note


class CheckpointCallback(BaseCallback):
    """Saves before a rollout begins: then all that has been flown has been learnt from.

    Args:
        folder: of the run.
        every: decisions between checkpoints; 0 for none.
        state: what to save.
    """

    def __init__(self, folder: Path, every: int, state: Callable[[], dict[str, Any]]) -> None:
        super().__init__()
        self._folder, self._every, self._state = folder, every, state
        self._due: int | None = None

    def _on_step(self) -> bool:
        return True

    def _on_rollout_start(self) -> None:
        if not self._every:
            return
        if self._due is None or self.num_timesteps >= self._due:
            Checkpoint(self._state()).save(self._folder)
            note(self._folder)
            self._due = self.num_timesteps + self._every
