"""The Stable-Baselines3 adapter: the three classic bugs, each shown to be caught, and what SB3 asks of a VecEnv."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from passloc_env import LocalisationEnv, LocalisationVectorEnv, ScenarioError
from passloc_env.distributions import Uniform

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import VecEnv, VecMonitor, VecNormalize

from passloc_env.sb3 import LocalisationVecEnv, make_vec_env

ENVIRONMENTS = 16
DECISIONS = 4
SHORT = {
    "episode.steps": 4 * DECISIONS,
    "target.start.range": Uniform(low=10.05e3, high=13e3),
}
"""Episodes of four decisions close to the keep-out of 10 km: some violate it, some run out of time, some do both."""


@pytest.fixture(autouse=True)
def logs_of_its_own(tmp_path, monkeypatch):
    """SB3 would leave a log folder in the system's temporary one."""
    monkeypatch.setenv("SB3_LOGDIR", str(tmp_path / "logs"))


def build(kind=LocalisationVecEnv, bootstrap=True, environments=ENVIRONMENTS):
    env = LocalisationVectorEnv(environments, overrides=SHORT, autoreset_mode=AutoresetMode.SAME_STEP)
    return kind(env, bootstrap_time_limit=bootstrap)


def actions(count, environments=ENVIRONMENTS):
    """Half of the environments fly at the emitter, half of them anywhere."""
    stream = np.random.default_rng(3).uniform(-1.0, 1.0, (count, environments, 1)).astype(np.float32)
    stream[:, ::2] *= 0.05
    return stream


def fly(env, steps=3 * DECISIONS):
    """Beside the adapter, the same seeds and actions in mode Disabled: ``(infos, dones, observation, …)`` per step.

    The reference hands over each last observation itself, before it is asked to begin the next episode.
    """
    reference = LocalisationVectorEnv(ENVIRONMENTS, overrides=SHORT, autoreset_mode=AutoresetMode.DISABLED)
    seeds = env.seed(11)
    first, _ = reference.reset(seed=list(seeds))
    assert np.array_equal(env.reset(), first)
    history = []
    for action in actions(steps):
        observation, _, dones, infos = env.step(action)
        last, _, terminated, truncated, _ = reference.step(action)
        ended = terminated | truncated
        following = reference.reset(options={"reset_mask": ended})[0] if ended.any() else last
        assert np.array_equal(dones, ended)
        assert np.array_equal(observation, following)
        history.append((infos, last, terminated, truncated))
    return history


def check_terminal_observations(env):
    """Looked at only after the whole flight, so that an alias of a buffer used again has been overwritten."""
    ended = 0
    for infos, last, terminated, truncated in fly(env):
        for index, info in enumerate(infos):
            assert ("terminal_observation" in info) == bool(terminated[index] or truncated[index])
            if "terminal_observation" in info:
                assert np.array_equal(info["terminal_observation"], last[index])
                assert info["terminal_observation"].dtype == np.float32
                ended += 1
    assert ended > 2 * ENVIRONMENTS


def check_time_limits(env, bootstrap=True):
    """``truncated and not terminated`` in all three kinds of ending."""
    kinds = set()
    for infos, _, terminated, truncated in fly(env):
        for index in np.flatnonzero(terminated | truncated):
            flag = infos[index]["TimeLimit.truncated"]
            assert isinstance(flag, bool)
            assert flag == (bootstrap and bool(truncated[index]) and not terminated[index])
            kinds.add((bool(terminated[index]), bool(truncated[index])))
    assert kinds == {(True, False), (False, True), (True, True)}


def check_seeds(env):
    """Runs 0 and 1 share no environment seed, none is near evaluation's, and each environment uses its own."""
    runs = [list(env.seed(seed)) for seed in (0, 1)]
    assert len(set(runs[0]) | set(runs[1])) == 2 * env.num_envs
    assert all(2**62 <= seed < 2**63 for run in runs for seed in run)
    assert list(env.seed(0)) == runs[0]
    first = env.reset()
    scalar = LocalisationEnv(overrides=SHORT)
    for index, seed in enumerate(runs[0]):
        assert np.array_equal(first[index], scalar.reset(seed=seed)[0])


class AliasOfTheBuffer(LocalisationVecEnv):
    """Hands out rows of one observation buffer that later steps fill again."""

    def step_wait(self):
        observation, reward, dones, infos = super().step_wait()
        if not hasattr(self, "_buffer"):
            self._buffer = observation.copy()
        for index in np.flatnonzero(dones):
            self._buffer[index] = infos[index]["terminal_observation"]
            infos[index]["terminal_observation"] = self._buffer[index]
        self._buffer[~dones] = observation[~dones]
        return observation, reward, dones, infos


class FirstOfTheNext(LocalisationVecEnv):
    """Takes the observation after the reset for the last one."""

    def step_wait(self):
        observation, reward, dones, infos = super().step_wait()
        for index in np.flatnonzero(dones):
            infos[index]["terminal_observation"] = observation[index].copy()
        return observation, reward, dones, infos


class TruncatedWhateverElse(LocalisationVecEnv):
    """Forgets that an episode may be over for two reasons at once."""

    def _final_info(self, index, info, out_of_time):
        out_of_time = self._lengths[index] == DECISIONS
        return super()._final_info(index, info, bool(out_of_time))


class AlwaysBootstraps(LocalisationVecEnv):
    """Flags every ending as a time limit."""

    def _final_info(self, index, info, out_of_time):
        return {**super()._final_info(index, info, out_of_time), "TimeLimit.truncated": True}


class CountsUp(LocalisationVecEnv):
    """SB3's own seeding."""

    seed = VecEnv.seed


class IgnoresSeeds(LocalisationVecEnv):
    """Seeds are computed and never used."""

    def reset(self):
        return self.env.reset()[0]


def test_terminal_observation_is_the_last_one():
    check_terminal_observations(build())


@pytest.mark.parametrize("kind", [AliasOfTheBuffer, FirstOfTheNext])
def test_wrong_terminal_observations_are_caught(kind):
    with pytest.raises(AssertionError):
        check_terminal_observations(build(kind))


@pytest.mark.parametrize("bootstrap", [True, False])
def test_time_limit_means_truncated_and_not_terminated(bootstrap):
    check_time_limits(build(bootstrap=bootstrap), bootstrap)


@pytest.mark.parametrize("kind", [TruncatedWhateverElse, AlwaysBootstraps])
def test_wrong_time_limits_are_caught(kind):
    with pytest.raises(AssertionError):
        check_time_limits(build(kind))


def test_every_environment_of_every_run_has_its_own_seed():
    check_seeds(build())


@pytest.mark.parametrize("kind", [CountsUp, IgnoresSeeds])
def test_wrong_seeding_is_caught(kind):
    with pytest.raises(AssertionError):
        check_seeds(build(kind))


def test_same_seed_same_bits():
    """Through several episodes; and seeds hold for one reset only, as SB3 has it."""
    runs = []
    for seed in (0, 0, 6):
        env = make_vec_env(n_envs=4, overrides=SHORT, seed=seed)
        observations = [env.reset(), *(env.step(action)[0] for action in actions(2 * DECISIONS, 4)), env.reset()]
        runs.append(np.stack(observations))
        assert not np.array_equal(runs[-1][0], runs[-1][-1])
    assert runs[0].tobytes() == runs[1].tobytes()
    assert not np.array_equal(runs[0], runs[2])


def test_without_a_seed_every_run_is_another():
    first = [make_vec_env(n_envs=2, overrides=SHORT).reset() for _ in range(2)]
    assert not np.array_equal(*first)
    env = build(environments=2)
    assert list(env.seed(None)) != list(env.seed(None))


def small_ppo(env, seed=0):
    return PPO(
        "MlpPolicy",
        env,
        n_steps=2 * DECISIONS,
        batch_size=32,
        n_epochs=1,
        gamma=0.9,
        policy_kwargs={"net_arch": [8]},
        seed=seed,
        device="cpu",
    )


class Watch(BaseCallback):
    """Keeps what the environment returned before PPO touches it."""

    def __init__(self):
        super().__init__()
        self.rewards, self.infos = [], []

    def _on_step(self):
        self.rewards.append(self.locals["rewards"].copy())
        self.infos.append(self.locals["infos"])
        return True


@pytest.mark.parametrize("bootstrap", [True, False])
def test_ppo_bootstraps_at_time_limits_alone(bootstrap):
    """The value of the terminal observation, times γ, is added to the reward where and only where time ran out."""
    model = small_ppo(build(bootstrap=bootstrap))
    asked, predict = [], model.policy.predict_values

    def spy(observation):
        value = predict(observation)
        asked.append((observation.numpy().copy(), value.numpy().copy()))
        return value

    model.policy.predict_values = spy
    watch = Watch()
    model.learn(2 * DECISIONS * ENVIRONMENTS, callback=watch)

    *terminal, (whole_batch, _) = asked
    assert len(whole_batch) == ENVIRONMENTS
    cut_short = [
        (step, index)
        for step, infos in enumerate(watch.infos)
        for index, info in enumerate(infos)
        if info.get("TimeLimit.truncated")
    ]
    endings = sum("terminal_observation" in info for infos in watch.infos for info in infos)
    assert len(terminal) == len(cut_short) < endings
    assert bool(cut_short) == bootstrap
    expected = np.stack(watch.rewards)
    for (step, index), (observation, value) in zip(cut_short, terminal, strict=True):
        assert np.array_equal(observation[0], watch.infos[step][index]["terminal_observation"])
        assert abs(value.item()) > 1e-6
        expected[step, index] += np.float32(0.9) * value.item()
    # One float32 product and one sum: two roundings of numbers of order one.
    np.testing.assert_allclose(model.rollout_buffer.rewards, expected, rtol=0, atol=1e-6)


def test_ppo_is_reproducible_by_its_seed():
    weights = []
    for seed in (0, 0, 1):
        model = small_ppo(build(environments=8), seed).learn(2 * DECISIONS * 8)
        assert model.num_timesteps == 2 * DECISIONS * 8
        weights.append(torch.nn.utils.parameters_to_vector(model.policy.parameters()).detach().numpy())
    assert np.isfinite(weights[0]).all()
    assert weights[0].tobytes() == weights[1].tobytes()
    assert not np.array_equal(weights[0], weights[2])


def test_shapes_and_types():
    env = build(environments=5)
    observation = env.reset()
    shape = (5, *env.observation_space.shape)
    for _ in range(DECISIONS + 1):
        assert (observation.shape, observation.dtype) == (shape, np.float32)
        observation, reward, dones, infos = env.step(np.zeros((5, 1), np.float32))
        assert (reward.shape, reward.dtype) == ((5,), np.float32)
        assert (dones.shape, dones.dtype) == ((5,), np.bool_)
        assert isinstance(infos, list)
        assert all(type(info) is dict for info in infos)
        assert env.observation_space.contains(observation[0])
    assert (env.num_envs, env.render_mode) == (5, None)
    assert env.action_space.shape == (1,)


def test_finished_episodes_tell_return_and_length():
    env = build()
    env.seed(2)
    env.reset()
    returns, lengths, ended = np.zeros(ENVIRONMENTS), np.zeros(ENVIRONMENTS, int), 0
    for action in actions(3 * DECISIONS):
        _, reward, dones, infos = env.step(action)
        returns, lengths = returns + reward, lengths + 1
        for index, info in enumerate(infos):
            assert bool(info) == bool(dones[index])
            if not info:
                continue
            ended += 1
            assert info["episode"].keys() == {"r", "l", "t"}
            # The adapter adds float64 rewards, this test their float32 casts: four roundings of numbers below 100.
            assert info["episode"]["r"] == pytest.approx(returns[index], abs=1e-4)
            assert (type(info["episode"]["r"]), type(info["episode"]["l"])) == (float, int)
            assert info["episode"]["l"] == lengths[index] <= DECISIONS
            assert info["episode"]["t"] >= 0.0
            assert {"range_bound", "gram_gain"} <= info["reward_terms"].keys()
            assert all(np.isscalar(term) for term in info["reward_terms"].values())
            assert type(info["violated"]) in (bool, np.bool_)
        returns[dones], lengths[dones] = 0.0, 0
    assert ended > ENVIRONMENTS


def test_diagnostics_belong_to_their_own_environment():
    env = make_vec_env(n_envs=3, overrides={**SHORT, "episode.early_end": False}, seed=4, diagnostics=True)
    seeds = env.seed(4)
    env.reset()
    for _ in range(DECISIONS):
        _, _, dones, infos = env.step(np.zeros((3, 1)))
    assert dones.all()
    scalar = LocalisationEnv(overrides={**SHORT, "episode.early_end": False}, diagnostics=True)
    for seed, info in zip(seeds, infos, strict=True):
        scalar.reset(seed=seed)
        for _ in range(DECISIONS):
            *_, expected = scalar.step(np.zeros(1))
        assert np.array_equal(info["truth"], expected["truth"])
        assert info["range"] == expected["range"]
        assert info["violated"] == expected["violated"]


def test_infos_and_arrays_are_fresh():
    env = build(environments=3)
    first = env.reset()
    kept, infos_kept = [first], []
    copies = [first.copy()]
    for action in actions(2 * DECISIONS, 3):
        observation, reward, dones, infos = env.step(action)
        for array in (observation, reward, dones):
            assert not any(np.shares_memory(array, other) for other in kept)
            kept.append(array)
            copies.append(array.copy())
        infos_kept.append(infos)
    assert all(np.array_equal(array, copy) for array, copy in zip(kept, copies, strict=True))
    everything = infos_kept + [info for infos in infos_kept for info in infos]
    assert len({id(item) for item in everything}) == len(everything)


def test_reset_forgets_unfinished_episodes():
    env = make_vec_env(n_envs=2, overrides={**SHORT, "episode.early_end": False}, seed=0)
    env.reset()
    env.step(np.full((2, 1), 0.5))
    env.reset()
    ends = [env.step(np.full((2, 1), 1.0)) for _ in range(DECISIONS)]
    assert [dones.any() for _, _, dones, _ in ends] == [False, False, False, True]
    assert [info["episode"]["l"] for info in ends[-1][3]] == [DECISIONS, DECISIONS]


def test_attributes_and_methods():
    env = build(environments=3)
    assert env.get_attr("num_envs") == [3, 3, 3]
    assert env.get_attr("scenario", indices=[0, 2]) == [env.env.scenario] * 2
    assert env.get_attr("num_envs", indices=1) == [3]
    assert env.has_attr("batch")
    assert not env.has_attr("no_such_attribute")
    env.set_attr("diagnostics", True)
    assert env.get_attr("diagnostics") == [True] * 3
    with pytest.raises(ValueError, match="shared by all environments"):
        env.set_attr("diagnostics", False, indices=[0])
    assert env.get_attr("diagnostics") == [True] * 3
    env.reset()
    states = env.env_method("get_state", indices=[0, 1])
    assert len(states) == 2
    assert len(states[0]["generators"]) == 3
    assert env.env_is_wrapped(Monitor) == [False] * 3
    assert env.env_is_wrapped(Monitor, indices=[0]) == [False]
    assert env.belief.mean.shape == (4, 3)
    env.close()


def test_normalising_and_monitoring_wrappers():
    plain = build()
    wrapped = VecNormalize(VecMonitor(build()), clip_obs=100.0)
    wrapped.seed(9)
    plain.seed(9)
    wrapped.reset()
    plain.reset()
    ended = 0
    for action in actions(2 * DECISIONS):
        observation, _, dones, infos = wrapped.step(action)
        expected, reward, expected_dones, expected_infos = plain.step(action)
        assert np.array_equal(wrapped.get_original_obs(), expected)
        assert np.array_equal(wrapped.get_original_reward(), reward)
        assert np.array_equal(dones, expected_dones)
        assert np.array_equal(observation, wrapped.normalize_obs(expected))
        for info, other in zip(infos, expected_infos, strict=True):
            if other:
                ended += 1
                last = wrapped.normalize_obs(other["terminal_observation"])
                assert np.array_equal(info["terminal_observation"], last)
                # VecMonitor adds up float32 rewards and rounds to six digits.
                assert info["episode"]["r"] == pytest.approx(other["episode"]["r"], abs=1e-3)
                assert info["episode"]["l"] == other["episode"]["l"]
    assert ended > ENVIRONMENTS


def test_evaluate_policy_counts_whole_episodes():
    env = VecMonitor(build(environments=4))
    returns, lengths = evaluate_policy(small_ppo(env), env, n_eval_episodes=6, return_episode_rewards=True)
    assert len(returns) == len(lengths) == 6
    assert np.isfinite(returns).all()
    assert set(lengths) <= set(range(1, DECISIONS + 1))


def test_refusals():
    with pytest.raises(ValueError, match="SameStep"):
        LocalisationVecEnv(LocalisationVectorEnv(2))
    with pytest.raises(ScenarioError, match="BearingsOnly"):
        make_vec_env("BearingOnly", 2)
    with pytest.raises(ValueError, match="num_envs"):
        make_vec_env(n_envs=0)
