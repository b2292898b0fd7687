"""Pictures of an evaluation: tracks flown on one seed, and the learning curve against the rules."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import matplotlib

matplotlib.use("Agg")

import matplotlib.pyplot as plt
import numpy as np
from gymnasium.vector import AutoresetMode
from matplotlib.axes import Axes
from matplotlib.patches import Circle as CirclePatch
from matplotlib.patches import Ellipse

from agents import Policy
from passloc_env.arrays import Array
from passloc_env.rendering.colours import BOUND, EMITTER, ESTIMATE, OBSERVER
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation
from passloc_env.vector_env import LocalisationVectorEnv
from training.episodes import decide
from training.evaluate import Evaluation
from training.train import Run

_ELLIPSES = 8
"""Belief ellipses drawn along an episode."""


class _Track:
    """Histories of a single episode, by sensor step."""

    def __init__(self, scenario: Scenario, policy: Policy, seed: int) -> None:
        flown = scenario.override({**policy.overrides, "episode.early_end": False})
        env = LocalisationVectorEnv(1, flown, autoreset_mode=AutoresetMode.DISABLED)
        self.own, self.emitter, self.mean, self.covariance, self.error, self.bound = ([] for _ in range(6))  # type: ignore[var-annotated]
        env.batch.tiles[0].watchers.append(self._watch)
        observation, _ = env.reset(seed=seed)
        rng = np.random.default_rng(seed)
        for _ in range(flown.episode.steps // flown.episode.decision_every):
            observation, *_ = env.step(decide(policy, env, observation, rng))

    def _watch(self, simulation: Simulation) -> None:
        outcome = simulation.outcome
        self.own.append(outcome.pose.position[:2, 0].copy())
        self.emitter.append(simulation.truth[:2, 0].copy())
        self.mean.append(simulation.track.mean[:2, 0].copy())
        self.covariance.append(simulation.track.covariance[:2, :2, 0].copy())
        self.error.append(float(outcome.relative_range_error[0]))
        self.bound.append(float(outcome.range_sigma[0] / outcome.range[0]))


def draw_tracks(scenario: Scenario, policies: Sequence[Policy], seed: int, path: Path) -> None:
    """Tracks, beliefs and errors of several policies on the same episode, one column each."""
    columns = len(policies)
    figure, axes = plt.subplots(
        2, columns, figsize=(4.2 * columns, 7.2), height_ratios=(2.2, 1.0), layout="constrained", squeeze=False
    )
    for column, policy in enumerate(policies):
        track = _Track(scenario, policy, seed)
        _draw_map(axes[0, column], track, scenario)
        axes[0, column].set_title(policy.name)
        _draw_errors(axes[1, column], track, scenario)
    # Below the axes, where no track can run into it.
    handles = [handle for row in (0, 1) for handle in axes[row, 0].get_legend_handles_labels()[0]]
    figure.legend(handles=handles, loc="outside lower center", ncols=len(handles), frameon=False)
    figure.suptitle(f"{scenario.name}, seed {seed}")
    figure.savefig(path, dpi=110)
    plt.close(figure)


def _draw_map(axes: Axes, track: _Track, scenario: Scenario) -> None:
    own, emitter = np.array(track.own) / 1e3, np.array(track.emitter) / 1e3
    axes.plot(*emitter.T, color=EMITTER, lw=2, label="emitter")
    axes.plot(*own.T, color=OBSERVER, lw=2, label="observer")
    axes.plot(*emitter[0], "o", color=EMITTER, ms=6)
    axes.plot(*own[0], "o", color=OBSERVER, ms=6)
    keep_out = CirclePatch(emitter[-1], scenario.episode.min_range / 1e3, fill=False, ls=":", color=EMITTER)
    keep_out.set_label("minimum range at the end")
    axes.add_patch(keep_out)
    steps = np.unique(np.geomspace(1, len(own), _ELLIPSES).astype(int)) - 1
    for number, step in enumerate(steps):
        ellipse = _ellipse(np.asarray(track.mean[step]) / 1e3, np.asarray(track.covariance[step]) / 1e6)
        ellipse.set(fill=False, color=ESTIMATE, lw=1.0, alpha=0.85)
        if number == 0:
            ellipse.set_label("belief, 2σ")
        axes.add_patch(ellipse)
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("east, km")
    axes.set_ylabel("north, km")
    axes.grid(alpha=0.3)


def _ellipse(centre: Array, covariance: Array) -> Ellipse:
    """The 2σ ellipse of a planar Gaussian."""
    values, vectors = np.linalg.eigh(covariance)
    angle = np.degrees(np.arctan2(vectors[1, 1], vectors[0, 1]))
    height, width = 4.0 * np.sqrt(np.maximum(values, 0.0))
    return Ellipse((centre[0], centre[1]), width, height, angle=float(angle))


def _draw_errors(axes: Axes, track: _Track, scenario: Scenario) -> None:
    time = scenario.episode.period * np.arange(1, len(track.error) + 1)
    axes.semilogy(time, 100.0 * np.array(track.error), color=ESTIMATE, lw=1.5, label="error of the estimate")
    axes.semilogy(time, 100.0 * np.array(track.bound), color=BOUND, lw=1.5, ls="--", label="Cramér–Rao bound on range")
    axes.set_ylim(0.05, 200.0)
    axes.set_xlabel("time, s")
    axes.set_ylabel("relative to range, %")
    axes.grid(alpha=0.3, which="both")


def draw_learning_curve(run: Run, evaluation: Evaluation, path: Path) -> None:
    """Return against wall time, and the final log range bound of every policy with its interval."""
    figure, (left, right) = plt.subplots(1, 2, figsize=(11.0, 4.4), layout="constrained")
    seconds = [row["seconds"] for row in run.curve]
    left.plot(seconds, [row["mean_return"] for row in run.curve], color=OBSERVER)
    left.set_xlabel("training time, s")
    left.set_ylabel("mean return per episode")
    left.set_title(f"{run.curve[-1]['decisions']:,.0f} decisions" if run.curve else "no episode finished")
    left.grid(alpha=0.3)
    violations = left.twinx()
    violations.plot(seconds, [100.0 * row["violations"] for row in run.curve], color=EMITTER, lw=1.0, alpha=0.7)
    violations.set_ylabel("violations in training, %", color=EMITTER)
    violations.set_ylim(0.0, 100.0)

    verdicts = sorted(evaluation.verdicts, key=lambda verdict: -verdict.log_range_bound.value)
    for row, verdict in enumerate(verdicts):
        estimate = verdict.log_range_bound
        colour = OBSERVER if verdict.policy == evaluation.reference else BOUND
        right.plot([estimate.low, estimate.high], [row, row], color=colour, lw=5, alpha=0.5)
        right.plot(estimate.value, row, "o", color=colour)
    right.set_yticks(range(len(verdicts)), [verdict.policy for verdict in verdicts])
    right.set_xlabel("log range bound, mean of ln(σ_r / r); lower is better")
    right.set_title(f"{evaluation.episodes} unseen episodes, 95 % intervals")
    right.grid(alpha=0.3, axis="x")
    figure.savefig(path, dpi=110)
    plt.close(figure)
