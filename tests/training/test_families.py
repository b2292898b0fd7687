"""Several problems learnt as one: every world stays itself, and an agent that could not fly them all is refused."""

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from passloc_env import SCENARIOS, ScenarioError
from passloc_env.errors import InputError
from passloc_env.sb3 import make_vec_env
from training.families import Together, families_of, shares
from training.hyperparameters import HyperparameterError, Hyperparameters
from training.learner import learning_env
from training.privileged import WithTruth
from training.train import check_training, run

SCENARIO = SCENARIOS["BearingsOnly"].override({"episode.steps": 40})
COARSE, SHORT = {"sensors.0.sigma": 0.05}, {"episode.steps": 20}
TINY = Hyperparameters(
    decisions=256,
    environments=7,
    rollout=16,
    batch_size=28,
    epochs=1,
    network=(8,),
    choices=8,
    mirror=True,
    privileged_critic=True,
    overrides={"prior.range": 30e3},
    families=(COARSE, SHORT),
)


pytestmark = pytest.mark.usefixtures("logs_of_its_own")


def worlds():
    return [make_vec_env(SCENARIO.override(changes), count) for changes, count in ((COARSE, 4), (SHORT, 3))]


def test_a_family_is_the_scenario_with_the_common_changes_and_then_its_own():
    coarse, short = families_of(SCENARIO, TINY)
    assert coarse == SCENARIO.override({"prior.range": 30e3, **COARSE})
    assert short == SCENARIO.override({"prior.range": 30e3, **SHORT})
    alone = dataclasses.replace(TINY, families=())
    assert families_of(SCENARIO, alone) == (SCENARIO.override({"prior.range": 30e3}),)


@pytest.mark.parametrize(("environments", "families"), [(1, 1), (7, 2), (512, 2), (10, 4), (4, 4)])
def test_environments_are_shared_out_evenly(environments, families):
    counts = shares(environments, families)
    assert sum(counts) == environments
    assert len(counts) == families
    assert max(counts) - min(counts) <= 1


def test_worlds_side_by_side_are_what_they_are_alone():
    """Through the ends of episodes, which come at different times in the two."""
    together, alone = Together(worlds()), worlds()
    seeds = together.seed(3)
    assert len(set(seeds)) == 7
    first, second = (np.random.SeedSequence(3).generate_state(2, np.uint64)).tolist()
    assert [*alone[0].seed(first), *alone[1].seed(second)] == list(seeds)
    np.testing.assert_array_equal(together.reset(), np.concatenate([world.reset() for world in alone]))
    rng, ended = np.random.default_rng(0), np.zeros(7, int)
    for _ in range(12):
        actions = rng.uniform(-1.0, 1.0, (7, 1)).astype(np.float32)
        observation, reward, done, infos = together.step(actions)
        parts = [world.step(own) for world, own in zip(alone, (actions[:4], actions[4:]), strict=True)]
        np.testing.assert_array_equal(observation, np.concatenate([part[0] for part in parts]))
        np.testing.assert_array_equal(reward, np.concatenate([part[1] for part in parts]))
        np.testing.assert_array_equal(done, np.concatenate([part[2] for part in parts]))
        assert [sorted(info) for info in infos] == [sorted(info) for part in parts for info in part[3]]
        ended += done
    assert ended.tolist() == [1, 1, 1, 1, 2, 2, 2]


def test_worlds_must_fit_each_other():
    with pytest.raises(ValueError, match="same spaces"):
        Together([make_vec_env(SCENARIO, 2), make_vec_env("CrossFix", 2)])


def test_what_belongs_to_a_world_is_asked_of_it():
    together = Together(worlds())
    steps = [scenario.episode.steps for scenario in together.get_attr("scenario")]
    assert steps == [40, 40, 40, 40, 20, 20, 20]
    assert [scenario.episode.steps for scenario in together.get_attr("scenario", [6, 0])] == [20, 40]
    assert together.env_is_wrapped(WithTruth, [0, 6]) == [False, False]
    assert [len(state["generators"]) for state in together.env_method("get_state", indices=[1, 5])] == [4, 3]
    together.set_attr("colour", "blue")
    assert together.get_attr("colour") == ["blue"] * 7
    with pytest.raises(ValueError, match="colour is shared"):
        together.set_attr("colour", "red", [0])
    together.close()


@pytest.mark.parametrize(
    ("families", "message"),
    [
        (
            ({"episode.steps": 20}, {"tracker": {"type": "InteractingModels"}}),
            "families.1 is not possible: it shows or asks something else than BearingsOnly",
        ),
        (
            ({}, {"bound.motion": {"type": "ConstantAcceleration"}}),
            "families.1 is not possible: it shows or asks something else than BearingsOnly",
        ),
        (
            ({"platforms.0.control": "turn_rate"}, {}),
            "families.0 is not possible: it shows or asks something else than BearingsOnly",
        ),
        (({},) * 8, "environments = 7 is not possible: 8 families need one each at least"),
    ],
)
def test_what_one_agent_cannot_fly_is_refused(families, message):
    parameters = dataclasses.replace(TINY, families=families)
    with pytest.raises(InputError) as caught:
        check_training(SCENARIO, parameters)
    assert str(caught.value) == message


def test_a_field_that_does_not_exist_is_refused_before_training():
    with pytest.raises(ScenarioError, match=r"families\.0\.episode\.stepps"):
        check_training(SCENARIO, dataclasses.replace(TINY, families=({"episode.stepps": 3},)))


def test_files_name_families(tmp_path):
    path = tmp_path / "own.yaml"
    path.write_text("families: [{episode.steps: 20}, {}]\n")
    assert Hyperparameters.load(path).families == ({"episode.steps": 20}, {})
    path.write_text("families: {episode.steps: 20}\n")
    with pytest.raises(HyperparameterError, match="must be a list of mappings"):
        Hyperparameters.load(path)


def test_an_agent_learns_from_all_families(tmp_path):
    """Both kinds of episodes end in its curve, and its card tells of both."""
    lengths = set()
    env = learning_env(SCENARIO, TINY, seed=0)
    env.reset()
    for _ in range(10):
        *_, infos = env.step(np.zeros((7, 1), int))
        lengths |= {info["episode"]["l"] for info in infos if "episode" in info}
    assert {5, 10} <= lengths
    agent = run(SCENARIO, TINY, tmp_path, 0, quiet=True).agent
    assert agent.card["training"]["hyperparameters"]["families"] == json.loads(json.dumps([COARSE, SHORT]))
    assert agent.scenario == SCENARIO.override({"prior.range": 30e3})
