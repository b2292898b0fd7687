"""Paper 004 inside the environment: the same trials as episodes, and what vehicles gain that move."""

from __future__ import annotations

import numpy as np

from agents import find_policy
from passloc_env.arrays import Array
from passloc_env.distributions import Uniform
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.scenarios.cross_fix import SIDE
from passloc_env.tracking import RecursiveCrossFix
from training.papers.monte_carlo import History, run
from training.papers.reproduction import Reproduction, Verdict, holds
from training.statistics import Bootstrap, rate

LIMITS = (0.3, 0.4, 0.5, 0.6)
"""Errors that Table 1 counts, in sides."""

_RULES = ("stationary", "straight", "circle", "zigzag:angle=60", "perpendicular")
_LOOKS = (1, 5, 20, 60)
_EPISODES = 4096
_PLAIN = RecursiveCrossFix(compensated=False, prior_rays=1e-9)
"""The paper's fix: no prior, no compensation."""


def one_look() -> Scenario:
    """The paper's simulation as an episode: everything anywhere in the square, one look, vehicles that stand still."""
    anywhere = Uniform(low=0.0, high=SIDE)
    places = {f"platforms.{vehicle}.position": (anywhere, anywhere) for vehicle in range(3)}
    return SCENARIOS["CrossFix"].override(
        {
            **places,
            "target.start.position": (anywhere, anywhere),
            "tracker": _PLAIN,
            "episode.steps": 1,
            "episode.decision_every": 1,
            "episode.min_range": 0.0,
        }
    )


def reproduce_in_the_environment(reproduction: Reproduction, positive_row: tuple[float, ...], trials: int) -> None:
    """Table 1 from episodes, and the table of fixed against moving vehicles.

    Args:
        reproduction: where to record.
        positive_row: P(error ≤ 30, 40, 50, 60 %) that the fix functions come to.
        trials: how many trials that row has.
    """
    episodes = min(trials, _EPISODES)
    error = run(one_look(), episodes, reproduction.seed, engine=reproduction.engine).error[-1] / SIDE
    shares = [rate(error <= limit) for limit in LIMITS]
    # Five standard deviations of the difference of two shares: by chance less than once in a million.
    room = 5.0 * np.sqrt(0.25 / episodes + 0.25 / trials)
    gaps = [abs(share.value - row) for share, row in zip(shares, positive_row, strict=True)]
    reproduction.claim(
        "the positive-range row, flown as episodes of the environment by vehicles that stand still",
        " / ".join(f"{value:.3f}" for value in positive_row),
        " / ".join(f"{share.value:.3f}" for share in shares),
        holds(max(gaps) < room),
        f"{episodes} episodes of one look; beside it what the fix functions came to in {trials} trials",
    )
    _fixed_against_moving(reproduction, min(trials, 1000))


def _fixed_against_moving(reproduction: Reproduction, runs: int) -> None:
    scenario = SCENARIOS["CrossFix"]
    plain = scenario.override({"tracker": _PLAIN})
    published = run(plain, runs, reproduction.seed, engine=reproduction.engine)
    rows = [_row("stationary, the paper's fix", published, runs)]
    ends: dict[str, Array] = {}
    for rule in _RULES:
        history = run(scenario, runs, reproduction.seed, rule, engine=reproduction.engine)
        ends[rule] = history.error[-1] / SIDE
        rows.append(_row(find_policy(rule, scenario).name, history, runs))
    headings = ("vehicles", *(f"{looks} look{'s' * (looks > 1)}" for looks in _LOOKS), "[95 %] at the end")
    reproduction.table("Median error over the side after so many looks: fixed against moving", headings, rows)
    gain = Bootstrap(runs).estimate(ends["zigzag:angle=60"] - ends["stationary"])
    reproduction.claim(
        "vehicles that move localise better than vehicles that stand still",
        "not said",
        gain,
        Verdict.REPRODUCED if gain.high < 0.0 else holds(False),
        f"CrossFix-v0, {runs} paired episodes of 60 looks; mean error over the side, 60° zigzag minus stationary",
    )


def _row(name: str, history: History, runs: int) -> tuple[str, ...]:
    medians = [f"{np.median(history.error[looks - 1]) / SIDE:.3f}" for looks in _LOOKS]
    end = Bootstrap(runs).estimate(history.error[-1] / SIDE, np.median)
    return (name, *medians, f"{end.low:.3f}–{end.high:.3f}")
