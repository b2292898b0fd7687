"""What goes wrong with sensors follows its law, counts in the bound as much as it tells, and is nobody else's business.

Seeds are fixed; each statistical test would have failed by chance with a probability of 1e-3 when they were chosen.
"""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy import stats

from passloc_env.distributions import Uniform
from passloc_env.faults import SOUND, Faults
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite, may_fail, may_miss
from passloc_env.sensors import Bearing, Doppler
from passloc_env.simulation import Simulation
from passloc_env.survey import Survey

FALSE_ALARM = 1e-3
SIGMA = 3e-3
EVERYTHING = {
    "sensors.0.faults": {
        "outlier_probability": Uniform(low=0.1, high=0.4),
        "late_probability": 0.2,
        "outage_start": Uniform(low=0.0, high=8.0),
        "outage_duration": 5.0,
    },
    "sensors.0.detection_probability": 0.7,
    "sensors.1.faults.outlier_probability": 0.3,
    "episode.early_end": False,
}

TRACKERS = (
    "UnscentedKalman",
    "ExtendedKalman",
    "SquareRootKalman",
    "RangeBank",
    "InteractingModels",
    "RecursiveCrossFix",
    "FilterPyTracker",
)

Begin = Callable[..., Simulation]


def faulty(**faults: Any) -> Scenario:
    changes = {f"sensors.0.faults.{name}": value for name, value in faults.items()}
    return Scenario().override({"episode.early_end": False, "episode.decision_every": 1, **changes})


def errors_of(seen: Simulation) -> np.ndarray:
    """Of the bearings just measured, in standard deviations ``(N,)``."""
    scene, suite = seen.scene(), seen.models.suite
    return suite.difference(seen.measure(scene)[0], suite.measure(scene))[0] / SIGMA


def flown(simulation: Simulation, look: Callable[[Simulation], np.ndarray], steps: int) -> np.ndarray:
    """What is seen after each of some steps ``(steps, …)``."""
    looks = []
    for _ in range(steps):
        simulation.step(np.zeros(simulation.action.shape))
        looks.append(np.array(look(simulation)))
    return np.stack(looks)


def spread(seen: Simulation) -> np.ndarray:
    """Volume of the belief in every environment."""
    return np.linalg.det(np.moveaxis(seen.track.covariance, -1, 0))


def test_by_default_nothing_goes_wrong() -> None:
    sensors = (Bearing(sigma=0.1), Doppler(sigma=1.0, carrier=1e9))
    assert all(sensor.faults == SOUND == Faults() for sensor in sensors)
    assert not may_fail(sensors)
    assert not may_miss(sensors)
    assert SensorSuite(sensors).inflation(np.zeros((4, 3))) is None


def test_errors_follow_the_contaminated_law(begin: Begin) -> None:
    """``(1 − ε) Φ(e) + ε Φ(e/k)``, of variance ``1 + ε (k² − 1)``."""
    chance, scale = 0.2, 5.0
    found = flown(begin(faulty(outlier_probability=chance, outlier_scale=scale), 500), errors_of, 20).ravel()

    def law(e: np.ndarray) -> np.ndarray:
        mixed: np.ndarray = (1.0 - chance) * stats.norm.cdf(e) + chance * stats.norm.cdf(e / scale)
        return mixed

    assert stats.kstest(found, law).pvalue > FALSE_ALARM
    assert stats.kstest(found, "norm").pvalue < 1e-6
    # Four standard errors of a variance, of which 3 (1 + ε (k⁴ − 1)) is the fourth moment.
    variance = 1.0 + chance * (scale**2 - 1.0)
    spread = np.sqrt((3.0 * (1.0 + chance * (scale**4 - 1.0)) - variance**2) / found.size)
    assert np.var(found) == pytest.approx(variance, abs=4.0 * spread)


def test_what_is_late_is_absent_whether_or_not_it_was_detected(begin: Begin) -> None:
    scenario = faulty(late_probability=0.25).override({"sensors.0.detection_probability": 0.8})
    heard = flown(begin(scenario, 500), lambda seen: seen.detected, 20)
    assert stats.binomtest(int(heard.sum()), heard.size, 0.8 * 0.75).pvalue > FALSE_ALARM


@pytest.mark.parametrize("tracker", TRACKERS)
def test_what_is_late_is_taken_in_before_the_next_instant(begin: Begin, tracker: str) -> None:
    """Where all are late, each belief is the one that a sound sensor led to a period before, predicted.

    The filters of FilterPy are told that what is missing is very noisy, so that a trace of it is left.
    """
    changes = {"tracker": {"type": tracker}, "platforms.0.control": "turn_rate"}
    sound, late = begin(faulty().override(changes), 3), begin(faulty(late_probability=1.0).override(changes), 3)
    before = Simulation(sound.scenario, 3)
    tolerance = 1e-6 if tracker == "FilterPyTracker" else 1e-12
    still = np.zeros((1, 3))
    late.step(still)
    for _ in range(8):
        sound.step(still)
        late.step(still)
        before.restore(sound.state_arrays())
        before.track.predict(before.time)
        before.information.advance()
        assert late.detected is not None
        assert not late.detected.any()
        scale = np.sqrt(np.einsum("iik->ik", before.track.covariance))
        np.testing.assert_allclose(late.track.mean, before.track.mean, rtol=0.0, atol=tolerance * scale.max())
        np.testing.assert_allclose(
            late.track.covariance, before.track.covariance, rtol=0.0, atol=tolerance * scale.max() ** 2
        )
        np.testing.assert_allclose(late.information.covariance, before.information.covariance, rtol=1e-12)
        np.testing.assert_allclose(late.information.gram_gain, sound.information.gram_gain, rtol=1e-9)


def test_the_decision_does_without_what_is_late_and_the_next_one_has_it(begin: Begin) -> None:
    """Beliefs are as wide as without the measurement at its instant, and as narrow as with it one later."""
    silent = {"outage_duration": 9.0}
    sound, late, missed = (begin(faulty(**faults), 1) for faults in ({}, {"late_probability": 1.0}, silent))
    widths = {id(simulation): flown(simulation, spread, 3) for simulation in (sound, late, missed)}
    np.testing.assert_allclose(widths[id(late)][0], widths[id(missed)][0], rtol=1e-12)
    assert (widths[id(sound)][1:] < widths[id(late)][1:]).all()
    assert (widths[id(late)][1:] < widths[id(missed)][1:]).all()


def test_faults_come_one_by_one(begin: Begin) -> None:
    """Neither in step with one another nor in runs: outliers and what is late are independent, and so are steps."""
    scenario = faulty(outlier_probability=0.5, late_probability=0.5)
    simulation = begin(scenario, 500)

    def look(seen: Simulation) -> np.ndarray:
        inflation = seen.models.suite.inflation(seen.noise_at().fault)
        assert inflation is not None
        return np.stack([inflation[0] > 1.0, seen.detected[0]])

    outlier, heard = np.moveaxis(flown(simulation, look, 20), 1, 0)
    for one, other in ((outlier, heard), (outlier[1:], outlier[:-1]), (heard[1:], heard[:-1])):
        table = [[np.sum(one & other), np.sum(one & ~other)], [np.sum(~one & other), np.sum(~one & ~other)]]
        assert stats.chi2_contingency(table).pvalue > FALSE_ALARM


def test_an_outage_is_silence_from_its_start_to_its_end(begin: Begin) -> None:
    simulation = begin(faulty(outage_start=3.0, outage_duration=4.0), 2)
    heard = flown(simulation, lambda seen: seen.detected[0], 10)
    np.testing.assert_array_equal(heard, np.repeat([[step not in range(4, 8)] for step in range(1, 11)], 2, axis=1))


def test_an_outage_may_come_at_any_time(begin: Begin) -> None:
    scenario = faulty(outage_start=Uniform(low=0.0, high=20.0), outage_duration=4.0)
    silent = ~flown(begin(scenario, 200), lambda seen: seen.detected[0], 30)
    np.testing.assert_array_equal(silent.sum(axis=0), np.full(200, 4))
    begun = silent.argmax(axis=0)
    assert stats.kstest(begun + np.random.default_rng(0).random(200), stats.uniform(0.0, 20.0).cdf).pvalue > FALSE_ALARM


def test_the_first_look_is_spared(begin: Begin) -> None:
    scenario = faulty(outlier_probability=1.0, outlier_scale=50.0, late_probability=1.0, outage_duration=9.0)
    sound, spared = begin(faulty(), 50), begin(scenario, 50)
    assert spared.measure(spared.scene())[0].tobytes() == sound.measure(sound.scene())[0].tobytes()
    assert spared.track.mean.tobytes() == sound.track.mean.tobytes()
    heard = spared.measure(spared.scene())[1]
    assert heard is not None
    assert heard.all()


def test_the_bound_counts_an_outlier_as_what_it_tells(begin: Begin) -> None:
    """``J ← F⁻ᵀ J F⁻¹ + hᵀh/(wσ)²`` with w the width of each error, in information form with NumPy's inverse.

    What came late was added before the propagation.
    """
    simulation = begin(faulty(outlier_probability=0.5, outlier_scale=7.0, late_probability=0.3), 3)
    back = np.linalg.inv(simulation.models.bound.dynamics.transition.matrix[..., 0])
    information = [np.linalg.inv(simulation.information.bound[..., column]) for column in range(3)]
    widths, pending, caught_up = set(), np.zeros((3, 4)), 0
    for _ in range(12):
        simulation.step(np.full((1, 3), 0.5))
        rows = simulation.models.suite.jacobian(simulation.bound_scene())
        width = simulation.models.suite.inflation(simulation.noise_at().fault)
        for column in range(3):
            row = rows[0, :, column] / (width[0, column] * SIGMA)
            information[column] += np.outer(pending[column], pending[column])
            caught_up += np.any(pending[column])
            information[column] = back.T @ information[column] @ back
            if simulation.detected[0, column]:
                information[column] += np.outer(row, row)
            pending[column] = row * (not simulation.detected[0, column])
            expected = np.linalg.inv(information[column])
            np.testing.assert_allclose(simulation.information.bound[..., column], expected, rtol=1e-6)
        widths |= set(width[0])
    assert widths == {1.0, 7.0}
    assert caught_up >= 3


def test_a_survey_counts_them_alike() -> None:
    """The path that was flown, asked about the emitter that was there, says what the simulation says."""
    scenario = SCENARIOS["BearingDoppler"].override(EVERYTHING | {"target.motion": {"type": "ConstantVelocity"}})
    survey = Survey(scenario, seed=4)
    there = survey.start[survey.layout.position]
    assert survey.bound_elsewhere(there)[0] == pytest.approx(survey.position_bound[-1], rel=1e-9)
    silent = [not np.any(rows[0]) for rows in survey.rows]
    assert sum(silent) >= 5
    information = sum(np.sum(rows**2) for rows in survey.rows)
    sound = Survey(scenario.override({"sensors.0.faults": {}, "sensors.1.faults": {}}), seed=4)
    assert information < sum(np.sum(rows**2) for rows in sound.rows)


@pytest.mark.parametrize("gate", [0.0, 0.9])
def test_every_environment_is_the_one_it_would_be_alone(begin: Begin, gate: float) -> None:
    """In a batch or alone, and by machine code as by the methods, to the last bit."""
    scenario = SCENARIOS["BearingDoppler"].override(EVERYTHING | {"tracker.gate": gate})
    whole, alone, slow = begin(scenario, 5), begin(scenario, 1, first_seed=3), Simulation(scenario, 5, straight=False)
    slow.reset(np.arange(5), [np.random.default_rng(seed) for seed in range(5)])
    for _ in range(6):
        for simulation in (whole, alone, slow):
            simulation.step(np.full((1, simulation.environments), 0.3))
    assert whole.flight is not None
    assert slow.flight is None
    states = whole.state_arrays()
    for name, array in slow.state_arrays().items():
        np.testing.assert_array_equal(array, states[name])
    for name, array in alone.state_arrays().items():
        np.testing.assert_array_equal(array[..., 0], states[name][..., 3])
    assert (whole.track.gated > 0).any() == bool(gate)


def test_random_faults_shift_nobody_elses_numbers(begin: Begin) -> None:
    """Not even those of the tracker and the platforms, which stand behind the sensors in a scenario."""
    base = Scenario().override({"sensors.0.sigma": Uniform(low=1e-3, high=1e-2)})
    plain = begin(base, 20)
    random = begin(base.override({"sensors.0.faults.outage_start": Uniform(low=0.0, high=1.0)}), 20)
    np.testing.assert_array_equal(random.realised.sensors[0].sigma, plain.realised.sensors[0].sigma)
    np.testing.assert_array_equal(random.truth, plain.truth)
    np.testing.assert_array_equal(random.track.mean, plain.track.mean)
    assert len(np.unique(random.realised.sensors[0].faults.outage_start)) == 20


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("outlier_probability", 1.5, "at least 0 and at most 1"),
        ("outlier_scale", 0.5, "at least 1"),
        ("late_probability", -0.1, "at least 0 and at most 1"),
        ("outage_duration", -1.0, "at least 0 s"),
    ],
)
def test_impossible_faults_are_refused(field: str, value: float, allowed: str, refusal: Callable[..., Any]) -> None:
    error = refusal(Scenario().override, {f"sensors.Bearing.faults.{field}": value})
    assert error.field == f"sensors.Bearing.faults.{field}" or error.field.endswith(field)
    assert allowed in error.allowed
