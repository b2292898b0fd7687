"""The differentiable world of the trajectory optimum against the world itself."""

import numpy as np
import pytest
import torch

from passloc_env import SCENARIOS
from passloc_env.distributions import Uniform
from passloc_env.errors import ScenarioError
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.sightline import Scene
from training.optimum.bound import Problem, _strides
from training.optimum.future import foresee
from training.optimum.jacobians import Look, jacobians
from training.optimum.path import Flyer, fly

FREE_NAMES = ["BearingsOnly", "BearingDoppler", "BearingDopplerUnknownCarrier", "OwnShipModerate", "DualArray"]
SHORT = {"episode.steps": 24}


def short(name):
    every = SCENARIOS[name].episode.decision_every
    return SCENARIOS[name].override({"episode.steps": 4 * every})


def some_turns(future, columns, seed=0):
    """Random turns ``(D, B)`` from nothing to the largest."""
    reach = np.minimum(future.largest_turn, 2.0)
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (future.decisions, columns)) * reach


@pytest.mark.parametrize("rate", [0.05, 0.5, np.inf])
def test_path_is_the_one_the_platform_flies(rate):
    """The closed form against the platform's own sensor steps; 1e-6 m is rounding over 20 km."""
    decisions, every, period, columns = 6, 5, 2.0, 40
    rng = np.random.default_rng(1)
    turns = rng.uniform(-1.0, 1.0, (decisions, columns)) * min(rate * every * period, 3.0)
    turns[0, :4], turns[:, 4] = 0.0, min(rate * every * period, 3.0)
    heading = rng.uniform(-np.pi, np.pi, columns)
    platform = TurnLimitedPlatform(position=(10.0, -20.0), speed=200.0, max_turn_rate=rate)
    state = platform.start(columns)
    state[2], state[4], state[5] = heading, np.sin(heading), np.cos(heading)
    start = (state[:2].copy(), heading, np.full(columns, 200.0), np.full(columns, rate))
    flyer = Flyer(*(torch.from_numpy(values) for values in start))
    instants = period * torch.arange(1, every + 1, dtype=torch.float64)
    path = fly(flyer, torch.from_numpy(turns), instants)
    wanted = heading + np.cumsum(turns, axis=0)
    for step in range(decisions * every):
        state = platform.move(state, wanted[step // every][None], period)
        np.testing.assert_allclose(path.position[:, step], state[:2], rtol=0, atol=1e-6)
        np.testing.assert_allclose(path.forward[:, step], state[4:], rtol=0, atol=1e-9)


@pytest.mark.parametrize("name", FREE_NAMES)
def test_jacobians_are_those_of_the_sensors(name):
    """Relative 1e-12: the same formulas in another library; rows left out are zeros."""
    future = foresee(short(name), range(5))
    problem = Problem(future)
    turns = torch.from_numpy(some_turns(future, 5))
    path = problem.path(turns)
    layout = future.layout
    offset = torch.from_numpy(future.truth[layout.position]) - path.position
    velocity = torch.from_numpy(future.truth[layout.velocity]) - problem.flyer.speed * path.forward
    rows = jacobians(future.sensors, Look(offset, velocity, path.forward, torch.from_numpy(future.truth), layout))
    platform = TurnLimitedPlatform(speed=future.speed[0], max_turn_rate=1.0)
    for step in range(future.truth.shape[1]):
        forward = path.forward[:, step].numpy()
        state = np.concatenate([path.position[:, step].numpy(), np.zeros((2, 5)), forward])
        state[2] = np.arctan2(forward[0], forward[1])
        pose = platform.pose(state)
        pose.velocity = future.speed * forward
        scene = Scene(future.truth[:, step], layout, [pose])
        for sensor, found in zip(future.sensors, rows, strict=True):
            expected = sensor.jacobian(scene)[0]
            scale = np.abs(expected).max(axis=1, keepdims=True)
            width = len(found)
            gap = np.abs(found[:, step].numpy() - expected[:width])
            assert (gap <= 1e-12 * scale[:width] + 1e-15 * scale.max()).all()
            assert not expected[width:].any()


def test_gradient_by_finite_differences():
    """Central differences of 1e-5 rad have an error near 1e-10 of the curvature; the tolerance is a hundredfold."""
    future = foresee(short("BearingDoppler"), range(3))
    for objective in ("log_range_bound", "end_position_bound"):
        problem = Problem(future, objective)
        turns = torch.from_numpy(0.7 * some_turns(future, 3)).requires_grad_()
        problem(turns).objective.sum().backward()
        for decision in range(future.decisions):
            step = torch.zeros_like(turns)
            step[decision] = 1e-5
            with torch.no_grad():
                slope = (problem(turns + step).objective - problem(turns - step).objective) / 2e-5
            np.testing.assert_allclose(turns.grad[decision], slope, rtol=1e-5, atol=1e-7)


def test_lumped_measurements_are_those_of_a_decision_together():
    """One decision per measurement: both ways of counting are one. Otherwise they differ, but by little."""
    every_step = foresee(SCENARIOS["BearingDoppler"].override({**SHORT, "episode.decision_every": 1}), range(4))
    turns = torch.from_numpy(some_turns(every_step, 4))
    exact, lumped = (Problem(every_step, lumped=flag)(turns).objective for flag in (False, True))
    assert torch.equal(exact, lumped)
    future = foresee(SCENARIOS["BearingDoppler"], range(4))
    turns = torch.from_numpy(some_turns(future, 4))
    exact, lumped = (Problem(future, lumped=flag)(turns).objective for flag in (False, True))
    assert not torch.equal(exact, lumped)
    assert (exact - lumped).abs().max() < 0.15


def test_several_steps_together_are_those_steps_one_by_one():
    """``F C Fᵀ + Q`` four times over, to 1e-12."""
    future = foresee(short("BearingDoppler"), [0])
    start = np.cov(np.random.default_rng(0).standard_normal((4, 9)))
    covariance, transition, noise = start, future.transition, future.process_noise[..., 0]
    for _ in range(4):
        covariance = transition @ covariance @ transition.T + noise
    advance, spread = (part.numpy() for part in _strides(future, 4))
    together = advance @ start.reshape(16, 1) + spread
    np.testing.assert_allclose(together.reshape(4, 4), covariance, rtol=1e-12)
    assert noise.any()


def test_truth_is_what_the_environment_draws():
    """Manoeuvres and process noise included, whatever the observer does and however many are asked at once."""
    for name in ("BearingDoppler", "OwnShipModerate"):
        all_of_them, one = (foresee(SCENARIOS[name], seeds) for seeds in (range(7, 12), [9]))
        taken = all_of_them.take(np.array([2]))
        for field in ("truth", "prior", "position", "heading", "speed"):
            assert np.array_equal(getattr(taken, field), getattr(one, field)), field
    straight = foresee(SCENARIOS["BearingDoppler"].override({"target.motion.kind": 0.0}), [9]).truth
    turning = foresee(SCENARIOS["BearingDoppler"].override({"target.motion.kind": 2.0}), [9]).truth
    assert np.abs(straight[:2] - turning[:2]).max() > 100.0


def test_random_sensors_follow_their_episodes():
    """A noise that is drawn anew in each episode stays with it."""
    loud = {
        "sensors.Bearing.sigma": Uniform(low=1e-3, high=2e-2),
        "sensors.Doppler.carrier": Uniform(low=1e9, high=5e9),
    }
    scenario = short("BearingDoppler").override(loud)
    both = Problem(foresee(scenario, [3, 4]).take(np.array([1, 0])))
    turns = torch.zeros((both.future.decisions, 2), dtype=torch.float64)
    alone = [Problem(foresee(scenario, [seed]))(turns[:, :1]).objective.item() for seed in (4, 3)]
    np.testing.assert_allclose(both(turns).objective, alone, rtol=1e-12)
    assert alone[0] != pytest.approx(alone[1], rel=1e-3)


@pytest.mark.parametrize(
    ("name", "changes", "words"),
    [
        ("CrossFix", {}, "needs one TurnLimitedPlatform"),
        ("DualSatellite", {}, "needs one TurnLimitedPlatform"),
        ("RadialAcceleration", {}, "knows Bearing, Doppler"),
        ("BearingsOnly", {"platforms.0.control": "turn_rate"}, "needs control 'heading'"),
        ("BearingsOnly", {"sensors.0.detection_probability": 0.9}, "never miss"),
        ("BearingDoppler", {"sensors.Doppler.lever_arm": (1.0, 0.0)}, "lever arms of bearings only"),
    ],
)
def test_scenarios_beyond_its_means(name, changes, words):
    with pytest.raises(ScenarioError, match=words) as caught:
        foresee(SCENARIOS[name].override(changes), [0])
    assert "\n" not in str(caught.value)
