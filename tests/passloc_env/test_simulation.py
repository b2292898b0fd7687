"""How episodes begin, go on and end; what happens in between is tested part by part."""

from collections.abc import Callable

import numpy as np
import pytest

from passloc_env.motion import ConstantVelocity
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart

# Northbound past an emitter that lies 100 m to the side: 400 m ahead of it, abreast after 2 s, 400 m behind after 4 s.
PASSING = Scenario().override(
    {
        "target.start": CartesianStart(position=(100.0, 400.0), velocity=(0.0, 0.0)),
        "platforms": [TurnLimitedPlatform(speed=200.0, max_turn_rate=0.1, control="turn_rate")],
        "episode.min_range": 150.0,
        "episode.lost_error": 1e9,
    }
)
STRAIGHT_ON = np.zeros((1, 1))


def test_a_violation_within_a_decision_is_not_forgotten(begin: Callable[..., Simulation]) -> None:
    simulation = begin(PASSING)
    simulation.step(STRAIGHT_ON)
    assert simulation.outcome.range[0] > 150.0
    assert (simulation.violated[0], simulation.breached[0], simulation.terminated[0]) == (True, True, True)
    simulation.step(STRAIGHT_ON)
    assert (simulation.violated[0], simulation.breached[0], simulation.terminated[0]) == (False, True, True)


def test_a_violation_need_not_end_the_episode(begin: Callable[..., Simulation]) -> None:
    simulation = begin(PASSING.override({"episode.early_end": False}))
    simulation.step(STRAIGHT_ON)
    assert (simulation.breached[0], simulation.terminated[0]) == (True, False)


@pytest.mark.parametrize(("lost_error", "lost"), [(1e-9, True), (1e9, False)])
def test_a_lost_track_ends_the_episode(lost_error: float, lost: bool, begin: Callable[..., Simulation]) -> None:
    simulation = begin(Scenario().override({"episode.lost_error": lost_error}))
    simulation.step(STRAIGHT_ON)
    assert (simulation.lost[0], simulation.terminated[0], simulation.breached[0]) == (lost, lost, False)


def test_an_error_that_is_no_number_is_a_lost_track(begin: Callable[..., Simulation]) -> None:
    simulation = begin(Scenario(), 3)
    simulation.truth[:, 1] = np.nan
    simulation.step(np.zeros((1, 3)))
    assert simulation.lost.tolist() == [False, True, False]


def test_a_track_through_the_station_tells_nothing_there(begin: Callable[..., Simulation]) -> None:
    """At zero range there is neither bearing nor Doppler: that look leaves belief and bound to the prediction."""
    through = SCENARIOS["BearingDoppler"].override(
        {
            "target.start": CartesianStart(position=(-20.0, 0.0), velocity=(10.0, 0.0)),
            "target.motion": ConstantVelocity(),
            "platforms.0.speed": 0.0,
            "episode.decision_every": 1,
            "episode.min_range": 0.0,
            "episode.early_end": False,
        }
    )
    simulation = begin(through, 3)
    gains, spreads = [], []
    for _ in range(3):
        simulation.step(STRAIGHT_ON.repeat(3, axis=1))
        assert np.isfinite(simulation.track.mean).all()
        gains.append(simulation.information.gram_gain.copy())
        spreads.append(np.trace(simulation.track.covariance))
    np.testing.assert_array_equal(np.array(gains) > 0.0, [[True] * 3, [False] * 3, [True] * 3])
    assert (spreads[1] > spreads[0]).all()


def test_time_runs_out_after_the_last_step(begin: Callable[..., Simulation]) -> None:
    simulation = begin(SCENARIOS["OwnShipModerate"].override({"episode.steps": 3}), 2)
    for step in range(3):
        np.testing.assert_array_equal(simulation.time, 60.0 * step)
        assert not simulation.truncated.any()
        simulation.step(np.zeros((1, 2)))
    assert simulation.truncated.all()


def test_actions_are_clipped_and_kept(begin: Callable[..., Simulation]) -> None:
    wild, tame = begin(Scenario(), 2), begin(Scenario(), 2)
    wild.step(np.array([[7.0, -1.5]]))
    tame.step(np.array([[1.0, -1.0]]))
    np.testing.assert_array_equal(wild.belief.last_action, [[1.0, -1.0]])
    np.testing.assert_array_equal(wild.platform_states[0], tame.platform_states[0])


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=list(SCENARIOS))
def test_a_new_episode_is_as_if_nothing_had_been_and_leaves_the_others_alone(
    scenario: Scenario, begin: Callable[..., Simulation]
) -> None:
    used, untouched, fresh = begin(scenario, 3), begin(scenario, 3), begin(scenario, 1, 70)
    for simulation in (used, untouched):
        simulation.step(np.full((1, 3), 0.4))
    used.track.repairs[:] = 5
    untouched.track.repairs[:] = 5
    used.reset(np.array([1]), [np.random.default_rng(70)])
    others, alone = untouched.state_arrays(), fresh.state_arrays()
    for name, values in used.state_arrays().items():
        assert values[..., 1].tobytes() == alone[name][..., 0].tobytes(), name
        assert values[..., [0, 2]].tobytes() == others[name][..., [0, 2]].tobytes(), name
    np.testing.assert_array_equal(used.observe()[:, [1]], fresh.observe())
