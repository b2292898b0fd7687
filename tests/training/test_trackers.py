"""What banks and interacting models are for, flown; each figure in brackets was measured over 1000 runs."""

import numpy as np
import pytest

from agents.catalogue import find_policy
from passloc_env.scenarios import SCENARIOS
from passloc_env.tracking import InteractingModels, RangeBank
from training.evaluate import evaluate
from training.statistics import root_mean_square

FIRST = 5_000_000
"""Development seeds."""


def test_bank_on_the_moderate_own_ship_comes_close_to_its_bound() -> None:
    """400 runs of the published legs: RMS over bound 1.1, where the plain filter's is 2.2.

    The standard deviation of an RMS of 400 nearly Gaussian errors is 4 %, so 1.3 is missed by chance in less than one
    seed of a thousand; the seed is fixed.
    """
    scenario = SCENARIOS["OwnShipModerate"]
    bank = scenario.replace(tracker=RangeBank(motion=scenario.tracker.motion))
    (verdict,) = evaluate(bank, [find_policy("legs", bank)], 400, FIRST).verdicts
    assert verdict.efficiency <= 1.3
    assert verdict.lost.value <= 0.01
    assert 0.8 < verdict.anees < 1.5


@pytest.mark.parametrize("rule", ["circle", "straight"])
def test_bank_is_no_worse_than_the_plain_filter(rule: str) -> None:
    """Same 300 episodes, so that 2 % is room enough: medians of the end error, of its time average, and ANEES."""
    scenario = SCENARIOS["BearingsOnly"]
    bank = scenario.replace(tracker=RangeBank(motion=scenario.tracker.motion))
    (plain,), (banked,) = (evaluate(s, [find_policy(rule, s)], 300, FIRST).verdicts for s in (scenario, bank))
    assert banked.end_error.value <= 1.02 * plain.end_error.value
    assert banked.mean_error.value <= 1.02 * plain.mean_error.value
    assert banked.end_rms.value <= 1.02 * plain.end_rms.value
    # Overconfidence is what an ANEES above one means.
    assert banked.anees <= max(1.02, plain.anees)


@pytest.mark.parametrize("rule", ["circle", "zigzag:angle=60"])
def test_models_follow_manoeuvres(rule: str) -> None:
    """Same 200 episodes: half of the plain filter's RMS relative error at the end [circle 0.13, zigzag 0.10].

    The time average includes the beginning, when nobody knows the range: three quarters of it [0.52, 0.46].
    """
    scenario = SCENARIOS["BearingDoppler"]
    models = scenario.replace(tracker=InteractingModels())
    runs = [evaluate(each, [find_policy(rule, each)], 200, FIRST) for each in (scenario, models)]
    (plain,), (mixed,) = (run.verdicts for run in runs)
    errors = [root_mean_square(next(iter(run.scores.values())).end_error) for run in runs]
    assert errors[1] < 0.5 * errors[0]
    assert mixed.mean_error.value < 0.75 * plain.mean_error.value
    assert mixed.lost.value <= plain.lost.value
    assert np.isfinite(mixed.anees)
    assert mixed.anees < 1.02
