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
from passloc_env.platforms import PlanarPose
from passloc_env.rewards import ControlEffort, GramGain, KeepOut, Outcome, RangeBound, TrackingError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation

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
    return Outcome(**{**values, **changes})


def test_range_bound_is_seen_along_the_true_line_of_sight() -> None:
    east, north = math.sin(2.0), math.cos(2.0)
    sigma = math.sqrt(400.0 * east**2 + 900.0 * north**2 + 2.0 * 100.0 * east * north)
    assert RangeBound().score(outcome())[0] == pytest.approx(-math.log(sigma / 5e3))


def test_gram_gain_is_the_information_gained() -> None:
    assert GramGain().score(outcome())[0] == 1.7


@pytest.mark.parametrize(("distance", "expected"), [(5e3, -0.1), (1e3, -0.5), (100.0, -1.0)])
def test_tracking_error_is_capped_at_one(distance: float, expected: float) -> None:
    assert TrackingError().score(outcome(distance))[0] == pytest.approx(expected)


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
