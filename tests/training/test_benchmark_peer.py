"""The hand-written FilterPy environment and passloc's own agree on every reward and observation of an episode.

They share nothing but the scenario, so this is an oracle for motion, platform, sensors, filter, bound, reward and
features at once.
"""

import gymnasium
import numpy as np
import pytest
from filterpy.common import Q_discrete_white_noise
from gymnasium.utils.env_checker import check_env

from passloc_env import SCENARIOS, LocalisationVectorEnv, ScenarioError
from passloc_env.motion import Manoeuvre
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.simulation import Simulation
from passloc_env.target import PolarStart
from training.benchmark.filterpy_env import FilterPyEnv
from training.benchmark.peer_tracking import process_noise, robust_root
from training.benchmark.peer_world import Draw, Manoeuvring, sinc, wrap

TOLERANCE = 1e-6
ACCELERATION, TURN = 1, 2


def realised_draw(simulation: Simulation) -> Draw:
    """What chance decided about the only episode of a simulation."""

    def number(value: object) -> float:
        return float(np.asarray(value).reshape(-1)[0])

    realised = simulation.realised
    start, motion, own = realised.target.start, realised.target.motion, realised.platforms[0]
    assert isinstance(start, PolarStart)
    assert isinstance(own, TurnLimitedPlatform)
    manoeuvring = Manoeuvring()
    if isinstance(motion, Manoeuvre):
        manoeuvring = Manoeuvring(
            int(number(motion.kind)),
            *(number(each) for each in (motion.start, motion.duration, motion.acceleration, motion.turn_rate)),
        )
    noise = simulation.noise.state_arrays()["measurement"][..., 0].copy()
    numbers = (start.range, start.bearing, start.speed, start.course, own.heading, own.speed)
    return Draw(*(number(each) for each in numbers), manoeuvring, noise)


def fly_both(name: str, seed: int, overrides: dict[str, object]) -> int:
    """Play one episode in both with the same actions, compare everything, and return its number of decisions."""
    ours = LocalisationVectorEnv(1, name, overrides=overrides, autoreset_mode="Disabled")
    theirs = FilterPyEnv(SCENARIOS[name].override(overrides))
    assert ours.single_observation_space == theirs.observation_space
    assert ours.single_action_space == theirs.action_space
    mine, _ = ours.reset(seed=seed)
    other, _ = theirs.reset(options={"episode": realised_draw(ours.batch.tiles[0])})
    np.testing.assert_allclose(other, mine[0], rtol=0, atol=TOLERANCE)

    random = np.random.default_rng(seed)
    decisions, ended = 0, False
    while not ended:
        # Beyond ±1 as well: both clip.
        action = random.uniform(-1.2, 1.2, 1).astype(np.float32)
        mine, reward, terminated, truncated, info = ours.step(action[None])
        other, other_reward, other_terminated, other_truncated, other_info = theirs.step(action)
        decisions += 1
        np.testing.assert_allclose(other, mine[0], rtol=0, atol=TOLERANCE)
        assert other_reward == pytest.approx(reward[0], rel=0, abs=TOLERANCE)
        for term, value in other_info["reward_terms"].items():
            assert value == pytest.approx(info["reward_terms"][term][0], rel=0, abs=TOLERANCE)
        assert (other_terminated, other_truncated) == (terminated[0], truncated[0])
        assert other_info["violated"] == info["violated"][0]
        ended = other_terminated or other_truncated
    return decisions


@pytest.mark.parametrize("seed", range(4))
def test_peer_agrees_with_accelerations_as_states(seed: int) -> None:
    motion = {"type": "ConstantAcceleration", "acceleration_noise": 0.5}
    assert fly_both("BearingDoppler", seed, {"episode.early_end": False, "tracker.motion": motion}) == 60


@pytest.mark.parametrize("name", ["BearingDoppler", "BearingsOnly"])
@pytest.mark.parametrize("seed", range(4))
def test_peer_agrees_over_whole_episodes(name: str, seed: int) -> None:
    assert fly_both(name, seed, {"episode.early_end": False}) == 60


@pytest.mark.parametrize("kind", [ACCELERATION, TURN])
@pytest.mark.parametrize("seed", range(3))
def test_peer_agrees_through_manoeuvres(kind: int, seed: int) -> None:
    overrides = {
        "target.motion.kind": kind,
        # From within one sensor step to within another.
        "target.motion.start": 30.37,
        "target.motion.duration": 81.81,
        "episode.early_end": False,
    }
    assert fly_both("BearingDoppler", seed, overrides) == 60


@pytest.mark.parametrize("name", ["BearingDoppler", "BearingsOnly"])
@pytest.mark.parametrize("end", [{"episode.min_range": 19.9e3}, {"episode.lost_error": 0.5}])
def test_peer_agrees_on_early_ends(name: str, end: dict[str, object]) -> None:
    overrides = {"target.start.range": {"type": "Uniform", "low": 20e3, "high": 21e3}, **end}
    lengths = [fly_both(name, seed, overrides) for seed in range(4)]
    assert min(lengths) < 60


def test_peer_agrees_with_other_numbers() -> None:
    overrides = {
        "episode.decision_every": 2,
        "episode.period": 0.5,
        "episode.min_range": 0.0,
        "sensors.Bearing.sigma": 0.02,
        "sensors.Doppler.sigma": 3.0,
        "sensors.Doppler.carrier": 1e9,
        "reward.GramGain.weight": 0.5,
        "tracker.alpha": 0.7,
        "tracker.kappa": 1.0,
        "observation.speed_scale": 100.0,
    }
    assert fly_both("BearingDoppler", 0, overrides) == 120


def test_a_sabotaged_peer_is_caught(monkeypatch: pytest.MonkeyPatch) -> None:
    def less_noise(motion: object, period: float) -> np.ndarray:
        return 0.999 * np.asarray(process_noise(motion, period))  # type: ignore[arg-type]

    monkeypatch.setattr("training.benchmark.peer_tracking.process_noise", less_noise)
    with pytest.raises(AssertionError):
        fly_both("BearingDoppler", 0, {})


@pytest.mark.parametrize("name", ["BearingDoppler", "BearingsOnly"])
def test_peer_is_a_gymnasium_environment(name: str) -> None:
    check_env(FilterPyEnv(name), skip_render_check=True)


def test_peer_draws_the_distributions_of_the_scenario() -> None:
    env = FilterPyEnv("BearingDoppler")
    env.reset(seed=0)
    draws = []
    for _ in range(300):
        env.reset()
        draws.append(env._draw)
    assert {each.manoeuvring.kind for each in draws} == {0, ACCELERATION, TURN}
    ranges = np.array([each.range for each in draws])
    assert ((ranges >= 20e3) & (ranges <= 60e3)).all()
    assert abs(ranges.mean() - 40e3) < 4 * (40e3 / np.sqrt(12 * 300))
    noise = np.concatenate([each.noise for each in draws])
    assert noise.shape == (300 * 241, 2)
    assert np.abs(noise.mean(axis=0)).max() < 4 / np.sqrt(len(noise))


def test_same_seed_same_episode() -> None:
    first, second = FilterPyEnv(), FilterPyEnv()
    np.testing.assert_array_equal(first.reset(seed=3)[0], second.reset(seed=3)[0])
    action = np.array([0.3], np.float32)
    assert first.step(action)[1] == second.step(action)[1]


@pytest.mark.parametrize(
    ("name", "overrides", "field"),
    [
        ("BearingDopplerUnknownCarrier", {}, "sensors"),
        ("OwnShipModerate", {}, "target.start"),
        ("BearingsOnly", {"platforms.0.control": "turn_rate"}, "platforms"),
        ("BearingsOnly", {"target.motion.acceleration_noise": 1.0}, "target.motion"),
        ("BearingDoppler", {"target.motion.kind": 3.0}, "target.motion.kind"),
    ],
)
def test_peer_refuses_what_it_was_not_written_for(name: str, overrides: dict[str, object], field: str) -> None:
    with pytest.raises(ScenarioError) as caught:
        FilterPyEnv(SCENARIOS[name].override(overrides))
    assert caught.value.field == field


def test_peer_refuses_other_rewards() -> None:
    scenario = SCENARIOS["BearingsOnly"]
    with pytest.raises(ScenarioError, match="reward"):
        FilterPyEnv(scenario.replace(reward=scenario.reward[:2]))


def test_an_indefinite_covariance_gets_a_root() -> None:
    covariance = np.array([[1.0, 1.1], [1.1, 1.0]])
    root = robust_root(covariance)
    values = np.linalg.eigvalsh(root.T @ root)
    assert values[0] == pytest.approx(1e-10 * 2.1, rel=1e-3)
    assert values[1] == pytest.approx(2.1)


def test_process_noise_is_filterpys() -> None:
    noise = process_noise(SCENARIOS["BearingDoppler"].bound.motion, 2.0)
    per_axis = Q_discrete_white_noise(2, 2.0, 9.0)
    np.testing.assert_allclose(noise[np.ix_([0, 2], [0, 2])], per_axis)
    np.testing.assert_allclose(noise[np.ix_([1, 3], [1, 3])], per_axis)


def test_small_helpers() -> None:
    assert sinc(0.0) == 1.0
    assert sinc(1e-3) == pytest.approx(1.0 - 1e-6 / 6.0, rel=1e-12)
    assert wrap(3.5) == pytest.approx(3.5 - 2.0 * np.pi)
    assert isinstance(FilterPyEnv(), gymnasium.Env)
