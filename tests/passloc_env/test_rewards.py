"""Each reward term from first principles, and their sum over a decision."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from passloc_env.dynamics import Dynamics
from passloc_env.information import Information
from passloc_env.layout import StateLayout
from passloc_env.motion import ConstantAcceleration, ConstantVelocity
from passloc_env.platforms import FixedStation, PlanarPose, Pose, TurnLimitedPlatform
from passloc_env.rewards import (
    ControlEffort,
    FilterCertainty,
    FinalBound,
    GramGain,
    KeepOut,
    Outcome,
    PositionError,
    RangeBound,
    TrackingError,
)
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart

MIN_RANGE = 1e3
OWN = np.array([[500.0], [100.0]])


def outcome(distance: float = 5e3, bearing: float = 2.0, turn_rate: float = 0.0, **changes: Any) -> Outcome:
    """One emitter at a distance and bearing, an estimate 300 m east and 400 m south of it, a bound and a belief."""
    u = np.array([[math.sin(bearing)], [math.cos(bearing)]])
    truth = np.concatenate([OWN + distance * u, [[10.0], [-5.0]]])
    velocity = np.array([[30.0], [40.0]])
    information = Information(Dynamics(ConstantVelocity(), StateLayout(), 1.0), 1)
    information.covariance[:2, :2, 0, 0] = [[400.0, 100.0], [100.0, 900.0]]
    information.gram_gain[...] = 1.7
    pose = PlanarPose(OWN, velocity, np.arctan2(*velocity), np.full(1, turn_rate))
    values: dict[str, Any] = {
        "scene": Scene(truth, StateLayout(), [pose]),
        "own_ship": 0,
        "mean": truth + np.array([[300.0], [-400.0], [1.0], [2.0]]),
        "covariance": np.diag([1e4, 4e4, 1.0, 4.0])[..., None],
        "layout": StateLayout(),
        "information": information,
        "action": np.zeros((1, 1)),
        "min_range": MIN_RANGE,
    }
    return Outcome(**{"commanded": (0,), "last": np.zeros(1, bool), **values, **changes})


def test_range_bound_is_seen_along_the_true_line_of_sight() -> None:
    east, north = math.sin(2.0), math.cos(2.0)
    sigma = math.sqrt(400.0 * east**2 + 900.0 * north**2 + 2.0 * 100.0 * east * north)
    assert RangeBound().score(outcome())[0] == pytest.approx(-math.log(sigma / 5e3))


def test_gram_gain_is_the_information_gained() -> None:
    assert GramGain().score(outcome())[0] == 1.7


@pytest.mark.parametrize(("distance", "expected"), [(5e3, -0.1), (1e3, -0.5), (100.0, -1.0)])
def test_tracking_error_is_capped_at_one(distance: float, expected: float) -> None:
    assert TrackingError().score(outcome(distance))[0] == pytest.approx(expected)


@pytest.mark.parametrize(("scale", "expected"), [(1e4, -0.05), (1e3, -0.5), (500.0, -1.0), (100.0, -1.0)])
@pytest.mark.parametrize("distance", [5e3, 100.0])
def test_position_error_counts_in_its_scale_and_is_capped_at_one(
    distance: float, scale: float, expected: float
) -> None:
    """The estimate is 500 m off, wherever the emitter is."""
    assert PositionError(scale=scale).score(outcome(distance))[0] == pytest.approx(expected)


@pytest.mark.parametrize(
    ("distance", "expected"), [(5e3, 0.0), (1200.0, 0.0), (1150.0, -0.25), (1000.0, -1.0), (10.0, -1.0), (0.0, -1.0)]
)
def test_keep_out_is_a_bounded_ramp(distance: float, expected: float) -> None:
    assert KeepOut().score(outcome(distance))[0] == pytest.approx(expected, abs=1e-9)


def test_keep_out_margin_and_absence() -> None:
    assert KeepOut(margin=0.5).score(outcome(1250.0))[0] == pytest.approx(-0.5)
    assert KeepOut().score(outcome(10.0, min_range=0.0))[0] == 0.0


@pytest.mark.parametrize("turn_rate", [0.0, 0.05, -0.1])
def test_control_effort_is_the_square_of_the_turn_rate(turn_rate: float) -> None:
    assert ControlEffort().score(outcome(turn_rate=turn_rate))[0] == pytest.approx(-((turn_rate / 0.05) ** 2))
    assert ControlEffort(reference=0.1).score(outcome(turn_rate=turn_rate))[0] == pytest.approx(
        -((turn_rate / 0.1) ** 2)
    )


def test_outcome_nees_and_violation() -> None:
    assert outcome().nees[0] == pytest.approx(300.0**2 / 1e4 + 400.0**2 / 4e4 + 1.0 + 1.0)
    assert [outcome(distance).violated[0] for distance in (999.0, 1001.0)] == [True, False]


@pytest.mark.parametrize(
    ("commanded", "closest"), [((0,), 5e3), ((1,), 900.0), ((0, 1), 900.0), ((1, 2, 0), 900.0), ((0, 2), 2e3)]
)
def test_the_nearest_commanded_platform_must_keep_away(commanded: tuple[int, ...], closest: float) -> None:
    """Range and line of sight stay the own ship's."""
    alone = outcome()
    emitter = alone.scene.state[:2]
    others = [Pose(emitter + np.array([[0.0], [away]]), np.zeros((2, 1))) for away in (900.0, -2e3)]
    scene = Scene(alone.scene.state, StateLayout(), [*alone.scene.poses, *others])
    state = outcome(scene=scene, commanded=commanded)
    assert state.closest[0] == pytest.approx(closest)
    assert state.violated[0] == (closest < MIN_RANGE)
    assert KeepOut().score(state)[0] == (-1.0 if closest < MIN_RANGE else 0.0)
    assert state.range[0] == pytest.approx(5e3)
    assert state.range_sigma[0] == alone.range_sigma[0]


def test_any_commanded_platform_may_violate_and_stations_may_not(begin: Callable[..., Simulation]) -> None:
    """Two aircraft and a station at the emitter's door: only the second aircraft comes too close, at 3.5 s."""
    aircraft = TurnLimitedPlatform(position=(0.0, 20e3), heading=math.pi, speed=200.0, max_turn_rate=0.05)
    changes: dict[str, Any] = {
        "target.start": CartesianStart(position=(0.0, 0.0), velocity=(0.0, 0.0)),
        "platforms": (
            FixedStation(position=(10.0, 10.0)),
            aircraft,
            TurnLimitedPlatform(position=(5.7e3, 0.0), heading=-math.pi / 2, speed=200.0, max_turn_rate=1e-9),
        ),
        "episode.min_range": 5e3,
        "episode.decision_every": 1,
        "sensors.0.platform": 1,
    }
    simulation = begin(Scenario().override(changes))
    flags = []
    for _ in range(8):
        simulation.step(np.zeros((2, 1)))
        flags.append((bool(simulation.violated[0]), bool(simulation.terminated[0])))
    assert simulation.outcome.closest[0] == pytest.approx(5.7e3 - 8 * 200.0)
    assert flags == [(False, False)] * 3 + [(True, True)] * 5


def test_nees_compares_what_truth_and_tracker_share() -> None:
    """An acceleration that the truth does not hold and a nuisance of another name are left out; a shared one is not."""
    layout = ConstantAcceleration().layout(2).with_nuisance(("bias", "carrier_offset"))
    true_layout = StateLayout(2, 1, ("turn_rate", "carrier_offset"))
    mean, truth = np.full((layout.size, 1), 3.0), np.zeros((true_layout.size, 1))
    covariance = 2.0 * np.eye(layout.size)[..., None]
    scene = Scene(truth, true_layout, outcome().scene.poses)
    state = outcome(scene=scene, mean=mean, covariance=covariance, layout=layout)
    assert state.nees[0] == pytest.approx(5 * 9.0 / 2.0)


@pytest.mark.parametrize("name", SCENARIOS)
def test_a_decision_earns_the_mean_over_its_sensor_steps(name: str, begin: Callable[..., Simulation]) -> None:
    terms = (
        RangeBound(weight=2.0),
        GramGain(weight=-0.5),
        TrackingError(weight=0.0),
        KeepOut(),
        ControlEffort(weight=3.0),
    )
    scenario = SCENARIOS[name].override({"reward": terms})
    simulation, history = begin(scenario, 4), []

    def watch(seen: Simulation) -> None:
        history.append([term.score(seen.outcome).copy() for term in terms])

    simulation.watchers.append(watch)
    rng = np.random.default_rng(0)
    for _ in range(4):
        history.clear()
        simulation.step(rng.uniform(-1, 1, (1, 4)))
        assert len(history) == scenario.episode.decision_every
        means = np.mean(history, axis=0)
        for term, mean in zip(terms, means, strict=True):
            np.testing.assert_allclose(simulation.reward_terms[term.name], mean, rtol=1e-12, atol=1e-14)
        weighted = sum(term.weight * mean for term, mean in zip(terms, means, strict=True))
        np.testing.assert_allclose(simulation.reward, weighted, rtol=1e-12)


def test_reward_does_not_ask_the_tracker_how_sure_it_is(begin: Callable[..., Simulation]) -> None:
    """An overconfident filter with the same estimate earns the same."""
    simulation = begin(Scenario())
    simulation.step(np.zeros((1, 1)))
    earned = [term.score(simulation.look(simulation.scene())) for term in simulation.scenario.reward]
    simulation.track.covariance *= 1e-6
    again = [term.score(simulation.look(simulation.scene())) for term in simulation.scenario.reward]
    np.testing.assert_array_equal(earned, again)


def test_no_reward_terms_earn_nothing(begin: Callable[..., Simulation]) -> None:
    simulation = begin(Scenario().override({"reward": ()}), 2)
    simulation.step(np.zeros((1, 2)))
    np.testing.assert_array_equal(simulation.reward, 0.0)
    assert simulation.reward_terms == {}


def test_the_final_bound_counts_once() -> None:
    """Minus the logarithm of √(400 + 900) m over the scale, at the last measurement alone."""
    term = FinalBound(scale=100.0)
    np.testing.assert_array_equal(term.score(outcome()), [0.0])
    ended = term.score(outcome(last=np.ones(1, bool)))
    np.testing.assert_allclose(ended, -math.log(math.sqrt(1300.0) / 100.0), rtol=1e-14)


def test_certainty_is_the_beliefs_own() -> None:
    """Deviations of 100 m and 200 m, whatever the truth: their geometric mean over the believed range."""
    seen = outcome()
    believed = math.hypot(*(seen.mean[:2, 0] - OWN[:, 0]))
    expected = math.log(believed / math.sqrt(100.0 * 200.0))
    np.testing.assert_allclose(FilterCertainty().score(seen), expected, rtol=1e-14)


def test_an_episode_ends_with_its_final_bound(begin: Callable[..., Simulation]) -> None:
    """In the simulation: zero until the last decision, then that of its last sensor step, averaged over the steps."""
    scenario = Scenario(reward=(FinalBound(scale=1e3),)).override({"episode.steps": 12, "episode.decision_every": 4})
    simulation = begin(scenario, 3)
    for decision in range(3):
        simulation.step(np.zeros((1, 3)))
        if decision < 2:
            np.testing.assert_array_equal(simulation.reward, 0.0)
    bound = np.sqrt(np.einsum("iin->n", simulation.information.bound[:2, :2]))
    np.testing.assert_allclose(simulation.reward, -np.log(bound / 1e3) / 4.0, rtol=1e-12)
