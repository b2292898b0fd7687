"""A gate keeps out the share that theory says, outliers above all, and nothing else changes.

What becomes of several models is held against a plain loop in test_multi_model.py.

Seeds are fixed; each statistical test would have failed by chance with a probability of 1e-3 when they were chosen.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from passloc_env.component import Component, concrete, specs
from passloc_env.faults import SOUND
from passloc_env.platforms import Pose
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing, Sensor
from passloc_env.sightline import Scene
from passloc_env.simulation import Simulation
from passloc_env.tracking import Tracker
from passloc_env.tracking.gating import Gate, chi_square_distribution, chi_square_quantile

FALSE_ALARM = 1e-3
STILL = {"type": "ConstantVelocity"}
GATED: dict[str, dict[str, Any]] = {
    "UnscentedKalman": {"motion": STILL},
    "ExtendedKalman": {"motion": STILL},
    "SquareRootKalman": {"motion": STILL},
    "CrossingKalman": {"motion": STILL},
    "RangeBank": {"motion": STILL},
    "InteractingModels": {"motions": [STILL, STILL]},
    "FilterPyTracker": {"motion": STILL},
}
"""The trackers that gate, and what makes each of them move as the emitter does."""

BY_METHODS_ALONE = {"FilterPyTracker"}
"""What is no straight-line code."""

SLOW = {"FilterPyTracker": 4}
"""How many times fewer environments a tracker is given: one filter after the other."""

Begin = Callable[..., Simulation]


def gated(gate: float, tracker: str = "UnscentedKalman", faults: Any = SOUND, **fields_of_tracker: Any) -> Scenario:
    """A prior so narrow that bearings are all but linear, and a tracker that moves as the emitter does."""
    changes = {
        "tracker": {"type": tracker, **GATED[tracker], "gate": gate, **fields_of_tracker},
        "sensors.0.faults": faults,
        "prior": {"type": "StatePrior", "position_sigma": 100.0, "velocity_sigma": 1.0},
        "episode.early_end": False,
        "episode.decision_every": 1,
    }
    return Scenario().override(changes)


@pytest.mark.parametrize("degrees", [1, 2, 3, 4, 7])
@pytest.mark.parametrize("probability", [1e-3, 0.5, 0.9, 0.99, 1.0 - 1e-9])
def test_quantiles_are_those_of_scipy(probability: float, degrees: int) -> None:
    quantile = chi_square_quantile(probability, degrees)
    assert quantile == pytest.approx(stats.chi2.ppf(probability, degrees), rel=1e-7)
    assert chi_square_distribution(quantile, degrees) == pytest.approx(probability, rel=1e-10)


def test_every_tracker_that_gates_is_tested_here() -> None:
    """Of our own; other tests make further ones."""
    kinds = [Component.registry[name] for name in concrete(Tracker)]
    ours = [kind for kind in kinds if kind.__module__.startswith("passloc_env.")]
    assert {kind.__name__ for kind in ours if "gate" in specs(kind)} == GATED.keys()


def test_a_tracker_that_cannot_gate_takes_none(refusal: Callable[..., Any]) -> None:
    error = refusal(SCENARIOS["CrossFix"].override, {"tracker.gate": 0.99})
    assert error.field == "tracker.gate"
    assert "no such field of RecursiveCrossFix" in error.allowed


@pytest.mark.parametrize("gate", [0.5, 0.9, 0.99])
@pytest.mark.parametrize("tracker", GATED)
def test_the_share_gated_is_what_theory_says(tracker: str, gate: float, begin: Begin) -> None:
    """At the first measurement, before the gate itself has changed what is left: a binomial share of 1 − P."""
    size = 4000 // SLOW.get(tracker, 1)
    simulation = begin(gated(gate, tracker), size)
    simulation.step(np.zeros((1, size)))
    assert stats.binomtest(int(simulation.track.gated.sum()), size, 1.0 - gate).pvalue > FALSE_ALARM


@pytest.mark.parametrize("gate", [0.5, 0.9])
def test_several_models_gate_by_the_widest(gate: float, begin: Begin) -> None:
    """One model is right, the other expects S' instead of S: ``2Φ(√(χ² S'/S)) − 1`` passes, environment by environment.

    Both expect the same bearing, so the wider gate is the union.
    """
    size, wide = 4000, {"type": "ConstantVelocity", "acceleration_noise": 300.0}
    simulation = begin(gated(gate, "InteractingModels", motions=[STILL, wide]), size)
    simulation.straight, track, ratio = False, simulation.track, []
    update, suite = track.update, track.models.suite

    def watched(measurement: np.ndarray, poses: list[Pose], detected: np.ndarray | None) -> None:
        means, covariances = track.components["means"], track.components["covariances"]
        slopes = suite.jacobian(Scene(means[:, 0], track.models.layout, poses))[0]
        right, other = np.einsum("an,abjn,bn->jn", slopes, covariances, slopes) + suite.noise_covariance[0]
        ratio.append(other / right)
        update(measurement, poses, detected)

    track.update = watched
    simulation.step(np.zeros((1, size)))
    assert 1.5 < np.median(ratio[0]) < 3.0
    passing = 2.0 * stats.norm.cdf(np.sqrt(stats.chi2.ppf(gate, 1) * ratio[0])) - 1.0
    deviation = (track.gated.sum() - np.sum(1.0 - passing)) / np.sqrt(np.sum(passing * (1.0 - passing)))
    assert 2.0 * stats.norm.sf(np.abs(deviation)) > FALSE_ALARM


@pytest.mark.parametrize("tracker", GATED)
def test_a_gate_that_refuses_nothing_changes_nothing(tracker: str, begin: Begin) -> None:
    """To the last bit."""
    alone, watched = (begin(gated(gate, tracker), 5) for gate in (0.0, 1.0 - 1e-15))
    for _ in range(10):
        for simulation in (alone, watched):
            simulation.step(np.full((1, 5), 0.5))
    assert not watched.track.gated.any()
    for name, values in alone.track.state_arrays().items():
        np.testing.assert_array_equal(watched.track.state_arrays()[name], values)


@pytest.mark.parametrize("tracker", GATED)
def test_no_gate_depends_on_the_batch(tracker: str, begin: Begin) -> None:
    """Flown together, flown alone, and done by the methods of simulation and track: the same to the last bit."""
    faults = {"outlier_probability": 0.3, "outlier_scale": 10.0}
    scenario = gated(0.8, tracker, faults=faults).override({"sensors.0.detection_probability": 0.7})
    whole = begin(scenario, 6)
    by_methods = Simulation(scenario, 6, straight=False)
    by_methods.reset(np.arange(6), [np.random.default_rng(column) for column in range(6)])
    singles = [begin(scenario, 1, column) for column in range(6)]
    for _ in range(15):
        for simulation in (whole, by_methods, *singles):
            simulation.step(np.full((1, simulation.environments), 0.5))
    assert whole.track.gated.sum() > 6
    assert (whole.flight is not None) == (tracker not in BY_METHODS_ALONE)
    for name, values in whole.track.state_arrays().items():
        np.testing.assert_array_equal(by_methods.track.state_arrays()[name], values)
        alone = np.concatenate([single.track.state_arrays()[name] for single in singles], axis=-1)
        np.testing.assert_array_equal(alone, values)


def test_it_stays_so_for_a_whole_episode(begin: Begin) -> None:
    """Cut tails make the filter a little surer than it says: a share within a fifth of 1 − P, here of 1 %."""
    simulation = begin(gated(0.99), 1000)
    for _ in range(100):
        simulation.step(np.zeros((1, 1000)))
    assert simulation.track.gated.mean() / 100 == pytest.approx(0.01, rel=0.2)


@pytest.mark.parametrize("tracker", GATED)
def test_outliers_are_thrown_out(tracker: str, begin: Begin) -> None:
    """Of errors a hundred times as wide all but 2.1 % lie beyond a gate of 99 %, and of the others 1 %."""
    faults = {"outlier_probability": 0.1, "outlier_scale": 100.0}
    size = 1000 // SLOW.get(tracker, 1)
    simulation = begin(gated(0.99, tracker, faults=faults), size)
    before = simulation.track.gated.copy()
    counts = np.zeros((2, 2))
    for _ in range(10):
        simulation.step(np.zeros((1, size)))
        width = simulation.models.suite.inflation(simulation.noise_at().fault)
        assert width is not None
        refused = (simulation.track.gated - before) > 0
        before = simulation.track.gated.copy()
        for kind, members in enumerate((width[0] == 1.0, width[0] > 1.0)):
            counts[kind] += [np.sum(refused & members), np.sum(members)]
    passing = 2.0 * stats.norm.cdf(stats.norm.ppf(0.995) / 100.0) - 1.0
    shares = counts[:, 0] / counts[:, 1]
    assert shares[1] == pytest.approx(1.0 - passing, abs=0.02)
    assert shares[0] == pytest.approx(0.01, abs=0.005)


@pytest.mark.parametrize("tracker", GATED)
def test_what_is_gated_is_as_good_as_not_detected(tracker: str, begin: Begin) -> None:
    """The belief that is left is the one of a filter that was never told, to the last bit."""
    simulation, deaf = begin(gated(0.5, tracker), 50), begin(gated(0.0, tracker), 50)
    time = simulation.time
    scene = simulation.scene()
    measurement, _ = simulation.measure(scene, simulation.noise.at(np.ones(50, int)))
    for each in (simulation, deaf):
        each.track.predict(time)
    simulation.track.update(measurement, scene.poses)
    refused = simulation.track.gated > 0
    assert 10 < refused.sum() < 40
    deaf.track.update(measurement, scene.poses, ~refused[None])
    np.testing.assert_array_equal(simulation.track.mean, deaf.track.mean)
    np.testing.assert_array_equal(simulation.track.covariance, deaf.track.covariance)
    np.testing.assert_array_equal(simulation.track.nis, deaf.track.nis)
    # FilterPy's mean of what is the same everywhere is rounded.
    assert (simulation.track.nis[refused] < 1e-20).all()


def test_the_filters_gate_alike(begin: Begin) -> None:
    """The unscented filter in another form or another's hands, a bank of one member, and models that are the same."""
    plain, *others = (
        begin(gated(0.8, tracker, **fields), 100)
        for tracker, fields in (
            ("UnscentedKalman", {}),
            ("SquareRootKalman", {}),
            ("RangeBank", {"members": 1}),
            ("InteractingModels", {}),
            ("FilterPyTracker", {}),
        )
    )
    for _ in range(20):
        for simulation in (plain, *others):
            simulation.step(np.full((1, 100), 0.5))
    assert plain.track.gated.sum() > 200
    for simulation in others:
        np.testing.assert_array_equal(simulation.track.gated, plain.track.gated)
        np.testing.assert_allclose(simulation.track.mean, plain.track.mean, rtol=1e-6)


def test_sensors_are_judged_one_by_one(begin: Begin) -> None:
    """A Doppler far off does not take the bearing with it."""
    faults = {"sensors.1.faults": {"outlier_probability": 1.0, "outlier_scale": 1e4}}
    scenario = SCENARIOS["BearingDoppler"].override(faults | {"tracker.gate": 0.99, "episode.early_end": False})
    simulation = begin(scenario, 100)
    before = simulation.track.covariance[0, 0] + simulation.track.covariance[1, 1]
    for _ in range(5):
        simulation.step(np.zeros((1, 100)))
    heard = simulation.scenario.episode.decision_every * 5
    assert simulation.track.gated.mean() == pytest.approx(heard, rel=0.05)
    after = simulation.track.covariance[0, 0] + simulation.track.covariance[1, 1]
    assert (after < before).all()


class Pair(Sensor):
    """Two correlated scalars of no meaning."""

    size, angular, detection_probability = 2, (False, False), 1.0
    platform, lever_arm = 0, ()

    def noise_covariance(self) -> np.ndarray:
        return np.array([[2.0, 1.0], [1.0, 3.0]])[..., None]


def test_a_sensor_of_several_scalars_is_judged_as_a_whole() -> None:
    """By its Mahalanobis distance with NumPy's inverse, and two degrees of freedom."""
    suite = SensorSuite((Pair(), Bearing(sigma=1.0)))
    rng = np.random.default_rng(0)
    root = rng.normal(size=(3, 3, 500))
    covariance = np.einsum("ikn,jkn->ijn", root, root) + suite.noise_covariance
    innovation = 3.0 * rng.normal(size=(3, 500))
    pair = np.linalg.inv(np.moveaxis(covariance[:2, :2], -1, 0))
    near = np.einsum("in,nij,jn->n", innovation[:2], pair, innovation[:2]) <= stats.chi2.ppf(0.7, 2)
    alone = innovation[2] ** 2 / covariance[2, 2] <= stats.chi2.ppf(0.7, 1)
    assert 50 < near.sum() < 450
    np.testing.assert_array_equal(Gate(0.7, suite).passed(innovation, covariance, suite), [near, near, alone])


def test_a_broken_filter_is_not_hidden_by_its_gate(begin: Begin) -> None:
    """What is not a number passes, and the track begins anew."""
    simulation = begin(gated(0.9), 3)
    simulation.watchers.append(lambda seen: seen.track.mean.__setitem__((0, 1), np.nan))
    simulation.step(np.zeros((1, 3)))
    simulation.watchers.clear()
    simulation.step(np.zeros((1, 3)))
    assert simulation.track.repairs.tolist() == [0, 1, 0]
    assert np.isfinite(simulation.track.mean).all()


def test_a_new_episode_counts_from_nothing(begin: Begin) -> None:
    simulation = begin(gated(0.5), 4)
    for _ in range(20):
        simulation.step(np.zeros((1, 4)))
    assert (simulation.track.gated > 0).all()
    simulation.reset(np.array([2]), [np.random.default_rng(9)])
    assert (simulation.track.gated > 0).tolist() == [True, True, False, True]


@pytest.mark.parametrize("gate", [-0.1, 1.0, {"type": "Uniform", "low": 0.5, "high": 0.9}])
def test_an_impossible_gate_is_refused(gate: Any, refusal: Callable[..., Any]) -> None:
    error = refusal(Scenario().override, {"tracker.gate": gate})
    assert error.allowed == "must be a plain number, at least 0 and below 1"
