"""What a search tries: around what is shipped, and only what can be trained."""

import pytest

pytest.importorskip("optuna")

import optuna
from optuna.trial import FixedTrial

from passloc_env import SCENARIOS
from training.hyperparameters import Hyperparameters
from training.search_space import suggest, unchanged


@pytest.mark.parametrize("name", SCENARIOS)
def test_what_is_shipped_is_in_the_space(name):
    """Optuna warns of values out of range, which fails the test."""
    base = Hyperparameters.for_scenario(name)
    assert suggest(FixedTrial(unchanged(base)), base) == base


@pytest.mark.parametrize("name", SCENARIOS)
def test_every_batch_is_whole(name):
    base = Hyperparameters.for_scenario(name)
    study = optuna.create_study(sampler=optuna.samplers.RandomSampler(seed=0))
    sizes = set()
    for _ in range(60):
        parameters = suggest(study.ask(), base)
        assert parameters.environments * parameters.rollout % parameters.batch_size == 0
        assert parameters.discount >= 0.9
        assert (parameters.discount == 1.0) == (base.discount == 1.0)
        sizes.add(parameters.batch_size)
    # Of at least four sizes, sixty draws miss a given one with a probability below 1e-5.
    assert {base.batch_size, base.environments * base.rollout // 32} <= sizes


def test_the_network_is_widened_as_a_whole():
    base = Hyperparameters(network=(64, 32, 16))
    wider = suggest(FixedTrial({**unchanged(base), "widening": 2.0}), base)
    assert wider.network == (128, 64, 32)
