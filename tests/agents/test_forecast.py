"""Forecasts: the same path, covariance and clock as the simulation and the Cramér–Rao recursion would have them."""

import dataclasses

import numpy as np
import pytest
from scipy.linalg import expm

from agents.forecast import Forecast, Pace, Situation
from passloc_env import SCENARIOS, LocalisationVectorEnv
from passloc_env.belief import Belief
from passloc_env.motion import ConstantVelocity, CoordinatedTurn
from passloc_env.observability import cramer_rao_path
from passloc_env.randomisation import take
from passloc_env.sightline import distance

ENVIRONMENTS = 3
ALL = [name for name, scenario in SCENARIOS.items() if scenario.action_size]
DIVERSE = ["BearingsOnly", "OwnShipSevere", "CrossFix", "DualArray", "BearingDopplerUnknownCarrier", "DualSatellite"]


def believed(name: str, decisions: int = 2, **overrides: object) -> tuple[LocalisationVectorEnv, Belief]:
    """An environment some decisions into its episodes, and its belief."""
    env = LocalisationVectorEnv(ENVIRONMENTS, name, overrides={"episode.early_end": False, **overrides})
    env.reset(seed=11)
    rng = np.random.default_rng(3)
    for _ in range(decisions):
        env.step(rng.uniform(-1.0, 1.0, (ENVIRONMENTS, env.scenario.action_size)))
    return env, env.belief


def finest(belief: Belief, decisions: int) -> Pace:
    return Pace((1,) * (decisions * round(belief.interval / belief.period)))


def plans(belief: Belief, legs: int, seed: int = 4) -> np.ndarray:
    controls = sum(platform.controls for platform in belief.platforms)
    return np.random.default_rng(seed).uniform(-1.0, 1.0, (legs, controls, len(belief.time)))


def emitter_step(belief: Belief) -> np.ndarray:
    """One period of the believed motion as the exponential of its differential equation, with a one as last state."""
    layout, motion = belief.layout, belief.motion
    rate = np.zeros((layout.size + 1, layout.size + 1))
    d = layout.dimension
    rate[: layout.kinematic.stop - d, d : layout.kinematic.stop] = np.eye(layout.kinematic.stop - d)
    if isinstance(motion, CoordinatedTurn):
        rate[d, d + 1], rate[d + 1, d] = motion.turn_rate, -motion.turn_rate
    elif isinstance(motion, ConstantVelocity) and motion.known_acceleration:
        rate[layout.velocity, -1] = motion.known_acceleration
    return expm(belief.period * rate)


def flown_by_hand(belief: Belief, plan: np.ndarray, decisions: int) -> tuple[list, np.ndarray]:
    """Poses at every sensor step and emitters at the end, one environment and one platform at a time."""
    every = round(belief.interval / belief.period)
    emitter, step_matrix = np.concatenate([belief.mean, np.ones((1, len(belief.time)))]), emitter_step(belief)
    states = [p.state_at(pose) for p, pose in zip(belief.platforms, belief.poses, strict=True)]
    path = []
    for step in range(decisions * every):
        if step % every == 0:
            action, first, held = plan[step * len(plan) // (decisions * every)], 0, []
            for platform, state in zip(belief.platforms, states, strict=True):
                offset = emitter[belief.layout.position] - platform.pose(state).position
                part = action[first : first + platform.controls]
                first += platform.controls
                held.append(platform.set_point(state, part, offset / distance(offset)))
        states = [p.move(s, h, belief.period) for p, s, h in zip(belief.platforms, states, held, strict=True)]
        emitter = step_matrix @ emitter
        path.append([p.pose(s) for p, s in zip(belief.platforms, states, strict=True)])
    return path, emitter[:-1]


@pytest.mark.parametrize("name", ALL)
def test_it_is_the_cramer_rao_bound_along_the_path(name):
    """At a stride of one step, with nothing lumped; 1e-9 for rounding in another order."""
    env, belief = believed(name)
    (world,) = env.batch.tiles
    plan = plans(belief, 2)
    path, emitter = flown_by_hand(belief, plan, 4)
    models = world.models.tracker
    bounds = cramer_rao_path(models.dynamics, models.suite, belief.mean, belief.covariance, path)
    looks = Forecast(Situation.of(belief), finest(belief, 4)).fly(plan)
    for look, bound, poses in zip(looks, bounds, path, strict=True):
        scale = np.sqrt(np.einsum("iin->in", bound))
        np.testing.assert_allclose(
            look.covariance / scale[:, None] / scale, bound / scale[:, None] / scale, rtol=0, atol=1e-9
        )
        for ours, theirs in zip(look.scene.poses, poses, strict=True):
            np.testing.assert_allclose(ours.position, theirs.position, rtol=1e-12, atol=1e-6)
    np.testing.assert_allclose(look.scene.state, emitter, rtol=1e-9, atol=1e-6)


@pytest.mark.parametrize("name", DIVERSE)
def test_platforms_go_where_the_simulation_takes_them(name):
    """One decision of the real world: the command is relative to the same line of sight, the path the same."""
    env, belief = believed(name)
    (world,) = env.batch.tiles
    plan = plans(belief, 1)
    looks = Forecast(Situation.of(belief), finest(belief, 1)).fly(plan)
    forecast = [[pose.position.copy() for pose in look.scene.poses] for look in looks]
    flown = []
    world.watchers.append(lambda simulation: flown.append([p.position.copy() for p in simulation.poses()]))
    env.step(plan[0].T)
    np.testing.assert_allclose(forecast, flown, rtol=1e-12, atol=1e-6)


def test_candidates_do_not_know_each_other():
    """Every column of a tiled forecast is what the environment gets alone, bit for bit, random numbers included."""
    _, belief = believed("BearingsOnly", **{"sensors.0.sigma": {"type": "Uniform", "low": 1e-3, "high": 5e-3}})
    situation = Situation.of(belief)
    columns = np.array([2, 0, 0, 1, 2])
    plan = np.random.default_rng(0).uniform(-1.0, 1.0, (2, 1, len(columns)))
    pace = Pace((4, 4, 8))
    together = [look.covariance.copy() for look in Forecast(situation.take(columns), pace).fly(plan)]
    for index, column in enumerate(columns):
        alone = Forecast(situation.take(np.array([column])), pace).fly(plan[..., index : index + 1])
        for one, all_of_them in zip(alone, together, strict=True):
            assert one.covariance[..., 0].tobytes() == all_of_them[..., index].copy().tobytes()


def test_noise_of_each_environment_counts():
    _, belief = believed("BearingsOnly", **{"sensors.0.sigma": {"type": "Uniform", "low": 1e-3, "high": 5e-3}})
    same = dataclasses.replace(belief, sensors=(take(belief.sensors[0], np.array([1, 1, 1])),))
    plan, pace = plans(belief, 1), finest(belief, 2)
    ours, theirs = (list(Forecast(Situation.of(b), pace).fly(plan))[-1].covariance for b in (belief, same))
    assert (ours[..., 1] == theirs[..., 1]).all()
    assert (ours[..., 0] != theirs[..., 0]).all()


def test_lumped_looks_are_close_to_single_ones():
    """Counting measurements late is an error of first order: with half the stride about a third of it is left.

    (From strides of 4 and 2 to one of 1: (2 − 1) / (4 − 1).)
    """
    _, belief = believed("BearingsOnly", decisions=10)
    plan = plans(belief, 3)
    paces = (finest(belief, 12), Pace((2,) * 24), Pace((4,) * 12))
    fine, middle, coarse = (list(Forecast(Situation.of(belief), pace).fly(plan))[-1].covariance for pace in paces)
    sigma = np.sqrt(np.einsum("iin->in", fine))
    late, later = (np.abs(np.sqrt(np.einsum("iin->in", c)) / sigma - 1.0).max(axis=0) for c in (middle, coarse))
    assert later.max() < 0.1
    assert (np.abs(late / later - 1.0 / 3.0) < 0.1).all()


def test_without_measurements_the_covariance_is_the_prediction():
    env, belief = believed("BearingDoppler")
    dynamics = env.batch.tiles[0].models.tracker.dynamics
    expected = belief.covariance.copy()
    for _ in range(8):
        dynamics.spread(expected)
    looks = [
        (look.unheard.copy(), look.decision)
        for look in Forecast(Situation.of(belief), Pace((4, 4))).fly(plans(belief, 1))
    ]
    np.testing.assert_allclose(looks[-1][0], expected, rtol=1e-9)
    assert [decision for _, decision in looks] == [1.0, 2.0]


def test_only_the_first_command_is_relative_to_the_sighted_emitter():
    """A platform that heads at what it sees, not at what is there, and from the second decision on at what is there."""
    _, belief = believed("OwnShipModerate")
    elsewhere = belief.mean.copy()
    elsewhere[:2] *= -1.0
    looks = Forecast(Situation.of(belief, elsewhere), finest(belief, 2)).fly(np.zeros((1, 1, ENVIRONMENTS)))
    course = []
    for look in looks:
        towards = look.scene.sightline(0).direction
        course.append((look.scene.poses[0].velocity * towards).sum(axis=0) / 5.0 / (1852 / 3600))
    sighted = (belief.mean[:2] - belief.poses[0].position) / belief.range
    assert (course[0] < 0.0).all()
    assert (course[1] > 0.99).all()
    assert (np.hypot(*sighted) == pytest.approx(1.0)) is True


@pytest.mark.parametrize(
    ("steps", "looks", "every", "strides"),
    [
        (4, 4, 4, (1, 1, 1, 1)),
        (4, 3, 4, (2, 2)),
        (48, 12, 4, (4,) * 12),
        (48, 24, 4, (2,) * 24),
        (48, 8, 4, (4, 4, 4, 4, 8, 8, 8, 8)),
        (240, 12, 4, (4,) * 6 + (36,) * 6),
        (56, 8, 4, (4, 4, 4, 4, 12, 12, 12, 4)),
        (32, 8, 1, (1, 1, 1, 1, 7, 7, 7, 7)),
        (12, 1, 4, (4, 8)),
    ],
)
def test_pace(steps, looks, every, strides):
    pace = Pace.of(steps, looks, every)
    assert pace.strides == strides
    assert pace.steps == steps


@pytest.mark.parametrize("every", [1, 3, 4, 10])
@pytest.mark.parametrize("looks", [1, 2, 5, 12])
def test_every_pace_covers_the_time_and_lets_decisions_begin_at_looks(every, looks):
    for decisions in range(1, 70):
        strides = Pace.of(decisions * every, looks, every).strides
        assert sum(strides) == decisions * every
        assert len(strides) <= looks + 1
        assert set(range(0, sum(strides[: (looks + 1) // 2]), every)) <= {0, *np.cumsum(strides)}
        assert all(stride % every == 0 or every % stride == 0 for stride in strides)
