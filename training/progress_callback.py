"""The progress bar of a training run; apart from the others because it imports Stable-Baselines3."""

from __future__ import annotations

from stable_baselines3.common.callbacks import BaseCallback

from training.progress import progress_bar


class ProgressCallback(BaseCallback):
    """Shows decisions done and the recent mean return."""

    def __init__(self, name: str, decisions: int, shown: bool = True) -> None:
        super().__init__()
        self._name, self._decisions = name, decisions
        self._bar = progress_bar("decisions", shown)

    def _on_training_start(self) -> None:
        self._task = self._bar.add_task(f"training on {self._name}", total=self._decisions)
        self._bar.start()

    def _on_step(self) -> bool:
        return True

    def _on_rollout_end(self) -> None:
        recent = [float(episode["r"]) for episode in self.model.ep_info_buffer or ()]
        words = f"training on {self._name}" + (f", return {sum(recent) / len(recent):.1f}" if recent else "")
        self._bar.update(self._task, completed=min(self.num_timesteps, self._decisions), description=words)

    def close(self) -> None:
        """Take the bar away, however the training ended."""
        self._bar.stop()
