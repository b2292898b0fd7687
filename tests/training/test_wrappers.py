"""What the learner meets: one side of the world, behind a shield, with scaled rewards; and agents that fly the same."""

import dataclasses
import json

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3.common.vec_env import VecEnv

from agents import AgentFile, LearnedPolicy, find_policy
from agents.shield import Shield
from agents.symmetry import MirrorSymmetry
from passloc_env import SCENARIOS, LocalisationVectorEnv, observation_names
from passloc_env.errors import InputError
from passloc_env.sb3 import LocalisationVecEnv, make_vec_env
from training.commands import Train
from training.hyperparameters import HyperparameterError, Hyperparameters
from training.learner import agent_of, build_ppo, learning_env
from training.run_folder import Assignment
from training.train import run, train
from training.wrappers import Choosing, Guarded, Mirrored, RisingPrice, ScaledReward

SCENARIO = SCENARIOS["BearingsOnly"].override(
    {"name": "Near", "episode.steps": 40, "target.start.range": 16e3, "platforms.0.max_turn_rate": 0.3}
)
"""Ten decisions, from where some fly into the emitter and the others run out of time; sides change at any of them."""
BOTH = Hyperparameters(
    decisions=512,
    environments=16,
    rollout=16,
    batch_size=64,
    epochs=2,
    learning_rate=1e-2,
    network=(8,),
    mirror=True,
    shield_sigmas=1.0,
    shielded_training=True,
)
N = 16
SYMMETRY = MirrorSymmetry(SCENARIO)
SIDE = observation_names(SCENARIO).index("own velocity across")


pytestmark = pytest.mark.usefixtures("logs_of_its_own")


def by_hand(observation):
    """One observation as seen on the other side, where its own ship moves to port."""
    return observation * SYMMETRY.parity if observation[SIDE] < 0.0 else observation


def sides_of(observation):
    return np.where(observation[:, [SIDE]] < 0.0, np.float32(-1.0), np.float32(1.0))


def actions_of(decision):
    """What a learner might do: mostly at the emitter, float32 as SB3 hands it over."""
    return np.random.default_rng(decision).uniform(-0.3, 0.5, (N, 1)).astype(np.float32)


def plain(**named):
    return make_vec_env(SCENARIO, N, seed=0, bootstrap_time_limit=False, **named)


def episode_of(info):
    return {key: value for key, value in info.get("episode", {}).items() if key != "t"}


def test_mirrored_shows_one_side_and_acts_on_both():
    """Against the same world stepped by hand: observations mirrored there, actions back, all else to the last bit."""
    world, mirrored = plain(), Mirrored(plain(), SYMMETRY)
    observation, seen = world.reset(), mirrored.reset()
    ended = crossed = changed = 0
    for decision in range(25):
        sides = sides_of(observation)
        assert set(sides.ravel().tolist()) == {-1.0, 1.0}
        np.testing.assert_array_equal(seen, np.array([by_hand(row) for row in observation]))
        assert seen.dtype == np.float32
        assert (seen[:, SIDE] >= 0.0).all()
        actions = actions_of(decision)
        observation, reward, done, infos = world.step(actions * sides)
        seen, found_reward, found_done, found_infos = mirrored.step(actions)
        assert found_reward.tobytes() == reward.tobytes()
        assert found_done.tobytes() == done.tobytes()
        for index in np.flatnonzero(done):
            last, found = infos[index]["terminal_observation"], found_infos[index]["terminal_observation"]
            np.testing.assert_array_equal(found, by_hand(last))
            assert found.shape == last.shape
            assert found.dtype == np.float32
            assert found_infos[index]["TimeLimit.truncated"] == infos[index]["TimeLimit.truncated"]
            ended += 1
            crossed += (last[SIDE] < 0.0) != (sides[index, 0] < 0.0)
            changed += (last[SIDE] < 0.0) != (observation[index, SIDE] < 0.0)
        assert [episode_of(info) for info in found_infos] == [episode_of(info) for info in infos]
    # Last observations on another side than the one before, or than the first of the next episode: each has its own.
    assert ended > crossed > 3
    assert ended > changed > 3


def test_guarded_flies_what_the_shield_lets_through():
    shield = Shield(1.0)
    world, guarded = plain(), Guarded(plain(), shield)
    np.testing.assert_array_equal(guarded.reset(), world.reset())
    replaced = 0
    for decision in range(25):
        actions = actions_of(decision)
        before = actions.copy()
        safe = shield.guard(world.belief, actions).astype(np.float32)
        replaced += (safe != actions).sum()
        expected, found = world.step(safe), guarded.step(actions)
        assert actions.tobytes() == before.tobytes()
        for one, other in zip(expected[:3], found[:3], strict=True):
            assert one.tobytes() == other.tobytes()
        assert [episode_of(info) for info in found[3]] == [episode_of(info) for info in expected[3]]
    assert 10 < replaced < 25 * N - 10


def test_the_shield_stands_in_the_world_and_not_in_the_mirror():
    """Guarded inside, mirrored outside: what is guarded are the actions mirrored back."""
    world, env = plain(), learning_env(SCENARIO, BOTH, seed=0)
    observation, seen = world.reset(), env.reset()
    replaced = 0
    for decision in range(20):
        actions = actions_of(decision)
        wanted = actions * sides_of(observation)
        safe = Shield(1.0).guard(world.belief, wanted).astype(np.float32)
        replaced += (safe != wanted).sum()
        observation, reward, done, infos = world.step(safe)
        seen, found_reward, found_done, found_infos = env.step(actions)
        np.testing.assert_array_equal(seen, np.array([by_hand(row) for row in observation]))
        assert found_reward.tobytes() == (reward * np.float32(BOTH.reward_scale)).tobytes()
        assert found_done.tobytes() == done.tobytes()
        assert [episode_of(info) for info in found_infos] == [episode_of(info) for info in infos]
    assert replaced > 10


def layers(env):
    """The wrappers from the outside in."""
    found = []
    while not isinstance(env, LocalisationVecEnv):
        found.append(type(env))
        env = env.venv
    return found


def innermost(env):
    """The environment itself."""
    while not isinstance(env, LocalisationVecEnv):
        env = env.venv
    return env


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({}, [ScaledReward]),
        ({"mirror": True}, [ScaledReward, Mirrored]),
        ({"mirror": True, "choices": 6}, [ScaledReward, Choosing, Mirrored]),
        ({"shield_sigmas": 2.0}, [ScaledReward]),
        ({"shield_sigmas": 2.0, "shielded_training": True}, [ScaledReward, Guarded]),
        ({"mirror": True, "shield_sigmas": 2.0, "shielded_training": True}, [ScaledReward, Mirrored, Guarded]),
    ],
)
def test_the_learner_meets_what_the_hyperparameters_say(changes, expected):
    env = learning_env(SCENARIO, dataclasses.replace(Hyperparameters(environments=4), **changes), seed=0)
    assert isinstance(env, VecEnv)
    assert layers(env) == expected
    assert env.num_envs == 4
    assert env.reset().shape == (4, len(observation_names(SCENARIO)))


def test_the_deviations_reach_the_shield():
    """With many, the emitter is never approached: every replacement is that of a shield so wide."""
    world, env = plain(), learning_env(SCENARIO, dataclasses.replace(BOTH, mirror=False, shield_sigmas=4.0), seed=0)
    world.reset()
    env.reset()
    actions = actions_of(0)
    wide = Shield(4.0).guard(world.belief, actions).astype(np.float32)
    assert (wide != Shield().guard(world.belief, actions).astype(np.float32)).any()
    np.testing.assert_array_equal(env.step(actions)[0], world.step(wide)[0])


def test_scaled_rewards_leave_the_episode_returns():
    world, scaled = plain(), ScaledReward(plain(), 0.25)
    np.testing.assert_array_equal(scaled.reset(), world.reset())
    ended = 0
    for decision in range(12):
        expected, found = world.step(actions_of(decision)), scaled.step(actions_of(decision))
        assert found[1].dtype == np.float32
        assert found[1].tobytes() == (expected[1] * np.float32(0.25)).tobytes()
        assert [episode_of(info) for info in found[3]] == [episode_of(info) for info in expected[3]]
        ended += expected[2].sum()
    assert ended >= N


def test_violations_grow_dear():
    """Each costs the share of the price that the training has come to; nothing else changes, least of all the truth."""
    env, world = RisingPrice(plain(), 100.0, decisions=12 * N), plain()
    np.testing.assert_array_equal(env.reset(), world.reset())
    paid = []
    for decision in range(16):
        found, expected = env.step(actions_of(decision)), world.step(actions_of(decision))
        violated = np.array([bool(info.get("violated")) for info in expected[3]]) & expected[2]
        price = 100.0 * min(decision / 12, 1.0)
        np.testing.assert_allclose(found[1], expected[1] - price * violated, rtol=1e-6, atol=1e-4)
        np.testing.assert_array_equal(found[0], expected[0])
        np.testing.assert_array_equal(found[2], expected[2])
        assert [episode_of(info) for info in found[3]] == [episode_of(info) for info in expected[3]]
        paid += [price] * violated.sum()
    # Some before and some after the price has reached its end, and some that ran out of time paid nothing.
    assert min(paid) < 100.0 == max(paid)
    assert len(paid) > N / 2


def test_a_price_is_asked_where_there_is_one():
    env = learning_env(SCENARIO, dataclasses.replace(BOTH, violation_price=30.0), seed=0)
    names = []
    while hasattr(env, "venv"):
        names.append(type(env).__name__)
        env = env.venv
    assert names == ["ScaledReward", "Mirrored", "RisingPrice", "Guarded"]


@pytest.mark.parametrize("changes", [{}, {"mirror": False}, {"shield_sigmas": 0.0}, {"choices": 12}], ids=str)
def test_the_agent_flies_as_the_model_flew_behind_the_wrappers(changes):
    """What reaches the world through the wrappers is what the agent does with NumPy alone in the same, bare world.

    1e-5: two float32 implementations of the same sums. Straight away is +1 or −1, whichever way it was rounded.
    """
    parameters = dataclasses.replace(BOTH, **changes)
    env = learning_env(SCENARIO, parameters, seed=5)
    model = build_ppo(env, parameters, seed=1)
    with torch.no_grad():
        model.policy.action_net.weight.mul_(100.0)
    policy = LearnedPolicy(agent_of(model, Assignment(SCENARIO, parameters, 1, {}), 1.0))
    bare = make_vec_env(SCENARIO, N, seed=1, bootstrap_time_limit=False)  # as SB3 seeds the other
    seen, observation = env.reset(), bare.reset()
    unsure = LearnedPolicy(
        AgentFile(policy.agent.weights, policy.agent.card | {"mirror": not parameters.mirror, "shield_sigmas": 0.0})
    )
    differs = 0.0
    for _ in range(20):
        wanted, _ = model.predict(seen, deterministic=True)
        flown = policy.act(observation, bare.belief, np.random.default_rng(0))
        differs = max(differs, np.abs(flown - unsure.act(observation, bare.belief, None)).max())
        seen, reward, done, _ = env.step(wanted)
        arrived = innermost(env)._actions
        apart = np.abs(flown - arrived)
        assert (np.minimum(apart, np.abs(2.0 - apart)) < 1e-5).all()
        observation, expected, ended, _ = bare.step(arrived)
        shown = np.array([by_hand(row) for row in observation]) if parameters.mirror else observation
        np.testing.assert_array_equal(seen, shown)
        np.testing.assert_array_equal(reward, expected * np.float32(parameters.reward_scale))
        np.testing.assert_array_equal(done, ended)
    assert differs > 0.1


def test_a_run_with_mirror_and_shield_writes_its_card_and_flies(tmp_path):
    finished = run(SCENARIO, BOTH, tmp_path, seed=2, quiet=True)
    card = AgentFile.load(tmp_path).card
    assert (card["mirror"], card["shield_sigmas"]) == (True, 1.0)
    assert card["training"]["hyperparameters"]["mirror"] is True
    config = json.loads((tmp_path / "config.json").read_text(encoding="utf-8"))
    assert (config["hyperparameters"]["mirror"], config["hyperparameters"]["shield_sigmas"]) == (True, 1.0)
    policy = find_policy(str(tmp_path), SCENARIO)
    env = LocalisationVectorEnv(N, SCENARIO)
    observation, _ = env.reset(seed=0)
    wishes = LearnedPolicy(AgentFile(finished.agent.weights, {**card, "shield_sigmas": 0.0}))
    for _ in range(10):
        actions = policy.act(observation, env.belief, np.random.default_rng(0))
        expected = Shield(1.0).guard(env.belief, wishes.act(observation, None, None))
        assert actions.tobytes() == expected.tobytes()
        observation, *_ = env.step(actions)
    assert np.isfinite(observation).all()


def test_a_run_without_says_so_and_is_another(tmp_path):
    weights = []
    for name, changes in (("bare", {"mirror": False, "shield_sigmas": 0.0}), ("both", {}), ("again", {})):
        (tmp_path / name).mkdir()
        finished = run(SCENARIO, dataclasses.replace(BOTH, **changes), tmp_path / name, seed=2, quiet=True)
        assert finished.agent.card["mirror"] is changes.get("mirror", True)
        assert finished.agent.card["shield_sigmas"] == changes.get("shield_sigmas", 1.0)
        weights.append(finished.agent.weights["actor.0.weight"])
    assert np.abs(weights[0] - weights[1]).max() > 1e-3
    assert weights[1].tobytes() == weights[2].tobytes()


def test_a_mirror_that_cannot_be_is_refused_before_there_is_a_folder(tmp_path, monkeypatch):
    """One line, and nothing left behind."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own.yaml").write_text("mirror: true\nenvironments: 2\n", encoding="utf-8")
    with pytest.raises(InputError, match="mirror = True is not possible") as caught:
        train(Train("DualSatellite", hyperparameters=tmp_path / "own.yaml", decisions=1))
    assert "\n" not in str(caught.value)
    assert [path.name for path in tmp_path.iterdir()] == ["own.yaml"]


def test_neither_is_the_default():
    assert (Hyperparameters().mirror, Hyperparameters().shield_sigmas) == (False, 0.0)


@pytest.mark.parametrize(("text", "expected"), [("mirror: true", True), ("mirror: false", False)])
def test_a_mirror_from_a_file(tmp_path, text, expected):
    (tmp_path / "own.yaml").write_text(text + "\n", encoding="utf-8")
    assert Hyperparameters.load(tmp_path / "own.yaml").mirror is expected


@pytest.mark.parametrize(("text", "expected"), [("0", 0.0), ("1.5", 1.5), ("3", 3.0)])
def test_deviations_from_a_file(tmp_path, text, expected):
    (tmp_path / "own.yaml").write_text(f"shield_sigmas: {text}\n", encoding="utf-8")
    assert Hyperparameters.load(tmp_path / "own.yaml").shield_sigmas == expected


@pytest.mark.parametrize(
    "line",
    [
        "mirror: 1",
        "mirror: left",
        "mirror: null",
        "mirror: []",
        "shield_sigmas: -1",
        "shield_sigmas: .nan",
        "shield_sigmas: .inf",
        "shield_sigmas: true",
        "shield_sigmas: wide",
        "shield_sigmas: null",
    ],
)
def test_what_is_neither_is_refused_by_name(tmp_path, line):
    (tmp_path / "own.yaml").write_text(line + "\n", encoding="utf-8")
    with pytest.raises(HyperparameterError, match=line.split(":")[0]) as caught:
        Hyperparameters.load(tmp_path / "own.yaml")
    assert "\n" not in str(caught.value)
