"""Evaluating while somebody watches."""

from __future__ import annotations

from collections.abc import Sequence

from agents import Policy
from passloc_env.scenario import Scenario
from training.commands import EVALUATION_SEED
from training.evaluate import Evaluation, evaluate
from training.progress import progress_bar


def judge(scenario: Scenario, policies: Sequence[Policy], episodes: int, seed: int = EVALUATION_SEED) -> Evaluation:
    """Evaluate with a progress bar; arguments and errors are those of :func:`training.evaluate.evaluate`."""
    with progress_bar("episodes") as bar:
        task = bar.add_task("judging", total=episodes * len(policies))

        def advance(policy: str, done: int) -> None:
            bar.update(task, advance=done, description=f"judging {policy}")

        return evaluate(scenario, policies, episodes, seed, progress=advance)
