"""What every tracker keeps, whatever the scenario: finite beliefs, the same bits in any batch, and its whole state."""

import numpy as np
import pytest

from passloc_env import SCENARIOS
from passloc_env.batch import Batch
from passloc_env.linalg import unsound
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, UnknownTurn
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation
from passloc_env.tracking import InteractingModels, RangeBank, UnscentedKalman

TRACKERS = {
    "plain": UnscentedKalman(motion=ConstantVelocity(acceleration_noise=0.5)),
    "bank": RangeBank(motion=ConstantVelocity(acceleration_noise=0.5)),
    "bank of turns": RangeBank(motion=UnknownTurn(acceleration_noise=0.1, turn_rate_noise=1e-3), members=3),
    "models of several states": InteractingModels(),
    "models of one state": InteractingModels(
        motions=(
            ConstantVelocity(acceleration_noise=0.1),
            CoordinatedTurn(turn_rate=0.02, acceleration_noise=0.1),
            CoordinatedTurn(turn_rate=-0.02, acceleration_noise=0.1),
        )
    ),
    "models by groups": InteractingModels(
        motions=(
            ConstantVelocity(acceleration_noise=0.1),
            ConstantAcceleration(acceleration_noise=0.1),
            ConstantVelocity(acceleration_noise=3.0),
        )
    ),
}
MISSING = {"sensors.0.detection_probability": 0.6, "sensors.1.detection_probability": 0.7}
RANDOM = {"sensors.0.sigma": {"type": "LogUniform", "low": 1e-3, "high": 1e-2}}
WORLDS: dict[str, Scenario] = {
    **SCENARIOS,
    "missing": SCENARIOS["BearingDopplerUnknownCarrier"].override(MISSING),
    "random sigma": SCENARIOS["BearingDoppler"].override(RANDOM),
}
MULTIPLE = [name for name in TRACKERS if name != "plain"]
STEPS = 6


def world(scenario: Scenario, tracker: str, environments: int = 3, first: int = 0) -> Simulation:
    changed = scenario.replace(tracker=TRACKERS[tracker]).override({"episode.early_end": False})
    simulation = Simulation(changed, environments)
    simulation.reset(np.arange(environments), [np.random.default_rng(first + column) for column in range(environments)])
    return simulation


def action(simulation: Simulation, step: int) -> np.ndarray:
    return np.full((simulation.scenario.action_size, simulation.environments), np.sin(1.0 + step))


def beliefs(simulation: Simulation) -> dict[str, np.ndarray]:
    return {name: values.copy() for name, values in simulation.track.state_arrays().items()}


def assert_equal(found: dict[str, np.ndarray], expected: dict[str, np.ndarray], columns: slice = slice(None)) -> None:
    assert found.keys() == expected.keys()
    for name, values in found.items():
        assert np.ascontiguousarray(values).tobytes() == np.ascontiguousarray(expected[name][..., columns]).tobytes()


@pytest.mark.parametrize("name", WORLDS)
@pytest.mark.parametrize("tracker", TRACKERS)
def test_beliefs_stay_sound(tracker, name):
    """Covariances symmetric to the last bit and positive definite, weights a distribution, observations finite."""
    simulation = world(WORLDS[name], tracker, 8)
    for step in range(STEPS):
        simulation.step(action(simulation, step))
        track = simulation.track
        assert np.isfinite(track.mean).all()
        assert np.isfinite(track.nis).all()
        assert np.isfinite(simulation.observe()).all()
        np.testing.assert_array_equal(track.covariance, track.covariance.swapaxes(0, 1))
        assert not unsound(track.covariance).any()
        assert track.components.keys() == simulation.belief.components.keys()
        if tracker in MULTIPLE:
            weights, means, covariances = track.components.values()
            # A handful of additions of numbers of at most one.
            np.testing.assert_allclose(weights.sum(axis=0), 1.0, atol=1e-14)
            assert (weights >= 0.0).all()
            assert np.isfinite(means).all()
            np.testing.assert_array_equal(covariances, covariances.swapaxes(0, 1))
            assert not unsound(covariances).any()


@pytest.mark.parametrize("name", ["BearingsOnly", "missing", "random sigma", "RadialAcceleration", "DualSatellite"])
@pytest.mark.parametrize("tracker", TRACKERS)
def test_bits_do_not_depend_on_the_batch(tracker, name):
    whole = world(WORLDS[name], tracker, 7)
    parts = [(slice(3, 4), world(WORLDS[name], tracker, 1, 3)), (slice(4, 6), world(WORLDS[name], tracker, 2, 4))]
    for step in range(STEPS):
        whole.step(action(whole, step))
        for columns, part in parts:
            part.step(action(part, step))
            assert_equal(beliefs(part), beliefs(whole), columns)


@pytest.mark.parametrize("name", ["BearingDoppler", "missing", "random sigma"])
@pytest.mark.parametrize("tracker", TRACKERS)
def test_state_goes_back(tracker, name):
    """Into the same world, and into one that has been somewhere else."""
    simulation, stranger = world(WORLDS[name], tracker), world(WORLDS[name], tracker, 3, 50)
    simulation.step(action(simulation, 0))
    saved = {key: values.copy() for key, values in simulation.state_arrays().items()}
    simulation.step(action(simulation, 1))
    later = beliefs(simulation)
    for each in (simulation, stranger):
        each.restore(saved)
        each.step(action(each, 1))
        assert_equal(beliefs(each), later)


@pytest.mark.parametrize("tracker", TRACKERS)
def test_some_begin_anew(tracker):
    """A reset of some environments is a first reset to them and nothing to the others."""
    scenario = WORLDS["BearingDoppler"]
    simulation, control = world(scenario, tracker, 4), world(scenario, tracker, 4)
    fresh = world(scenario, tracker, 2, 70)
    for each in (simulation, control):
        each.step(action(each, 0))
    again = np.array([1, 3])
    simulation.reset(again, [np.random.default_rng(70), np.random.default_rng(71)])
    found, kept, new = beliefs(simulation), beliefs(control), beliefs(fresh)
    for name, values in found.items():
        np.testing.assert_array_equal(values[..., again], new[name])
        np.testing.assert_array_equal(values[..., [0, 2]], kept[name][..., [0, 2]])


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("field", ["mean", "covariance"])
@pytest.mark.parametrize("tracker", TRACKERS)
def test_a_belief_that_went_non_finite_begins_anew(tracker, field, value):
    """All of it, once: the restart is counted, and the neighbours notice nothing."""
    simulation, control = (world(WORLDS["BearingDoppler"], tracker) for _ in range(2))

    def spoil(spoilt: Simulation) -> None:
        if spoilt.step_count[1] == 2:
            getattr(spoilt.track, field)[..., 1] = value
            if tracker in MULTIPLE:
                getattr(spoilt.track.members, field)[..., 1] = value

    simulation.watchers.append(spoil)
    for each in (simulation, control):
        each.step(action(each, 0))
    np.testing.assert_array_equal(simulation.track.repairs, [0, 1, 0])
    for name, values in beliefs(simulation).items():
        assert np.isfinite(values).all(), name
        np.testing.assert_array_equal(values[..., [0, 2]], beliefs(control)[name][..., [0, 2]])


@pytest.mark.parametrize("tracker", MULTIPLE)
def test_a_member_that_went_non_finite_follows_the_likeliest(tracker):
    """A member broken in its prediction costs its belief and nothing else: no restart, and the others go on."""
    simulation = world(WORLDS["BearingDoppler"], tracker)
    simulation.straight = False
    track, predict = simulation.track, simulation.track.predict

    def spoil(time: np.ndarray) -> None:
        predict(time)
        if time[1] == 2.0:
            track.members.covariance[:2, :2, 0, 1] = np.nan

    track.predict = spoil
    simulation.step(action(simulation, 0))
    np.testing.assert_allclose(track.weights.sum(axis=0), 1.0, atol=1e-14)
    assert not simulation.track.repairs.any()
    for name, values in beliefs(simulation).items():
        assert np.isfinite(values).all(), name
    assert not unsound(simulation.track.components["covariances"]).any()


@pytest.mark.parametrize("tracker", TRACKERS)
def test_an_indefinite_covariance_is_repaired_and_counted(tracker):
    simulation = world(WORLDS["BearingDoppler"], tracker)
    simulation.straight = False
    track, predict = simulation.track, simulation.track.predict

    def spoil(time: np.ndarray) -> None:
        predict(time)
        if time[1] == 2.0:
            covariance = track.members.covariance[:, :, 0] if tracker in MULTIPLE else track.covariance
            covariance[0, 1, 1] = covariance[1, 0, 1] = 2.0 * np.sqrt(covariance[0, 0, 1] * covariance[1, 1, 1])

    track.predict = spoil
    simulation.step(action(simulation, 0))
    np.testing.assert_array_equal(track.repairs, [0, 1, 0])
    assert not unsound(track.covariance).any()


@pytest.mark.parametrize("tracker", MULTIPLE)
def test_tiles_join_the_components(tracker):
    scenario = WORLDS["BearingDoppler"].replace(tracker=TRACKERS[tracker])
    whole, tiled = Batch(scenario, 5, tile=5), Batch(scenario, 5, tile=2)
    for batch in (whole, tiled):
        for index in range(5):
            batch.seed(index, index)
        batch.reset(np.ones(5, bool))
        batch.step(np.zeros((5, 1)))
    assert whole.belief.components
    assert_equal(tiled.belief.components, whole.belief.components)
