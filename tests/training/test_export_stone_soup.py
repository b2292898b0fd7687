"""Stone Soup judges an exported flight as we do, hears what we hear, and its filter believes what ours believes."""

import math
from datetime import UTC, datetime, timedelta

import numpy as np
import pytest

from agents import find_policy
from passloc_env import SCENARIOS
from passloc_env.sightline import Scene
from training.benchmark.peer_tracking import process_noise, transition
from training.export.flight import Flight, fly

pytest.importorskip("stonesoup")

from stonesoup.dataassociator.tracktotrack import TrackToTruth
from stonesoup.measures import Euclidean, SquaredMahalanobis
from stonesoup.metricgenerator.manager import MultiManager
from stonesoup.metricgenerator.ospametric import OSPAMetric
from stonesoup.metricgenerator.tracktotruthmetrics import SIAPMetrics
from stonesoup.models.transition.linear import LinearGaussianTimeInvariantTransitionModel
from stonesoup.predictor.kalman import ExtendedKalmanPredictor, UnscentedKalmanPredictor
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.state import State
from stonesoup.updater.kalman import ExtendedKalmanUpdater, UnscentedKalmanUpdater

from training.export.stone_soup import (
    detections,
    ground_truth,
    platforms,
    position_mapping,
    track,
    velocity_mapping,
)

EPOCH = datetime(2000, 1, 1, tzinfo=UTC)
NAMES = ["BearingsOnly", "BearingDopplerUnknownCarrier", "DualArray", "DualSatellite", "CrossFix"]


def flown(name: str, policy: str = "random", **changes) -> Flight:
    scenario = SCENARIOS[name].override(changes)
    return fly(scenario, find_policy(policy, scenario), 3)


@pytest.fixture(scope="module", params=NAMES)
def flight(request: pytest.FixtureRequest) -> Flight:
    return flown(request.param)


def test_instants_count_from_the_epoch(flight: Flight) -> None:
    expected = [EPOCH + timedelta(seconds=time) for time in flight.time]
    assert [state.timestamp for state in ground_truth(flight, EPOCH)] == expected
    assert [state.timestamp for state in track(flight, EPOCH)] == expected
    assert [time for time, _ in detections(flight, EPOCH)] == expected


def test_distance_is_our_error_times_range(flight: Flight) -> None:
    measure = Euclidean(position_mapping(flight.track_layout))
    pairs = zip(track(flight, EPOCH), ground_truth(flight, EPOCH), strict=True)
    distances = [measure(believed, true) for believed, true in pairs]
    np.testing.assert_allclose(distances, flight.relative_range_error * flight.range, rtol=1e-9)


def test_squared_mahalanobis_distance_is_our_nees(flight: Flight) -> None:
    """Over the states that truth and track share; theirs inverts the covariance, ours solves with its root."""
    shared = tuple(row for row, _ in flight.track_layout.shared_rows(flight.truth_layout))
    # Their pseudo-inverse drops directions below 1e-15 of the largest, radians beside metres: compare in deviations.
    found = []
    for believed, true in zip(track(flight, EPOCH), ground_truth(flight, EPOCH), strict=True):
        sigma = np.sqrt(np.diag(believed.covar))
        believed.state_vector = believed.state_vector / sigma[:, None]
        believed.covar = believed.covar / np.outer(sigma, sigma)
        true.state_vector = true.state_vector / sigma[:, None]
        found.append(SquaredMahalanobis(mapping=shared, state_covar_inv_cache_size=0)(believed, true))
    np.testing.assert_allclose(found, flight.nees, rtol=1e-9)


def test_metrics_by_name_agree() -> None:
    """OSPA with a large cutoff and SIAP's positional accuracy are our position error."""
    flight = flown("BearingsOnly", "circle")
    rows = position_mapping(flight.track_layout)
    position, velocity = Euclidean(rows), Euclidean(velocity_mapping(flight.track_layout))
    generators = [
        OSPAMetric(p=1, c=1e9, measure=position, generator_name="ospa"),
        SIAPMetrics(position_measure=position, velocity_measure=velocity, generator_name="siap"),
    ]
    manager = MultiManager(generators, associator=TrackToTruth(association_threshold=1e9, measure=position))
    manager.add_data({"groundtruth_paths": {ground_truth(flight, EPOCH)}, "tracks": {track(flight, EPOCH)}})
    metrics = manager.generate_metrics()
    errors = flight.relative_range_error * flight.range
    ospa = [metric.value for metric in metrics["ospa"]["OSPA distances"].value]
    np.testing.assert_allclose(ospa, errors, rtol=1e-9)
    siap = [metric.value for metric in metrics["siap"]["SIAP Position Accuracy at times"].value]
    # Their associator begins at the second instant.
    np.testing.assert_allclose(siap[1:], errors[1:], rtol=1e-9)
    assert metrics["siap"]["SIAP Completeness"].value == pytest.approx(1.0, abs=1.0 / len(errors))


def test_models_measure_the_truth_as_our_sensors_do(flight: Flight) -> None:
    """Noise-free, from the reported poses; a bearing of theirs is a quarter turn less ours."""
    truth = ground_truth(flight, EPOCH)
    clean = _noise_free_as_reported(flight)
    compared = 0
    for instant, (_, heard) in enumerate(detections(flight, EPOCH)):
        for detection in heard:
            value = np.asarray(detection.measurement_model.function(truth[instant], noise=False), float)[:, 0]
            expected = clean[flight.suite.rows[detection.metadata["sensor"]], instant]
            if detection.metadata["kind"] == "Bearing":
                gap = (expected - (math.pi / 2.0 - value) + math.pi) % math.tau - math.pi
                np.testing.assert_allclose(gap, 0.0, atol=1e-12)
            else:
                np.testing.assert_allclose(value, expected, rtol=1e-9, atol=1e-12)
            compared += 1
    assert compared == flight.detected.sum()


def _noise_free_as_reported(flight: Flight) -> np.ndarray:
    layout = flight.track_layout
    return flight.suite.measure(Scene(layout.convert(flight.truth, flight.truth_layout), layout, flight.reported))


def test_bearings_by_hand() -> None:
    """An emitter due north is at 0 for us and at a quarter turn for them; due east, the other way round."""
    start = {"type": "CartesianStart", "position": [0.0, 4e4], "velocity": [0.0, 0.0]}
    flight = flown("BearingsOnly", "stationary", **{"target.start": start, "sensors.Bearing.sigma": 1e-9})
    _, (detection,) = detections(flight, EPOCH)[0]
    assert float(detection.state_vector[0, 0]) == pytest.approx(math.pi / 2.0, abs=1e-7)
    assert flight.measurement[0, 0] == pytest.approx(0.0, abs=1e-7)


def test_missed_detections_are_not_there() -> None:
    flight = flown("BearingsOnly", **{"sensors.Bearing.detection_probability": 0.5})
    heard = [len(now) for _, now in detections(flight, EPOCH)]
    assert heard == flight.detected[0].astype(int).tolist()
    assert 0 in heard


def test_platforms_follow_their_paths(flight: Flight) -> None:
    for platform, pose in zip(platforms(flight, EPOCH), flight.poses, strict=True):
        for state in platform.path[1:]:
            platform.move(state.timestamp)
        followed = np.hstack([state.state_vector[platform.position_mapping, :] for state in platform.states])
        np.testing.assert_allclose(np.asarray(followed, float), pose.position, rtol=1e-12)


SPREAD = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
FILTERS = {
    "UnscentedKalman": (UnscentedKalmanPredictor, UnscentedKalmanUpdater, SPREAD),
    "ExtendedKalman": (ExtendedKalmanPredictor, ExtendedKalmanUpdater, {}),
}


@pytest.mark.parametrize(
    ("kind", "name", "tolerance"),
    [
        ("UnscentedKalman", "BearingsOnly", 1e-5),
        # Stone Soup differentiates its bearing numerically.
        ("ExtendedKalman", "BearingsOnly", 1e-4),
        # It absorbs the detections of an instant one after the other, and linearises anew in between.
        ("UnscentedKalman", "BearingDoppler", 0.3),
        ("ExtendedKalman", "BearingDoppler", 0.3),
    ],
)
def test_their_filter_believes_what_ours_believes(kind: str, name: str, tolerance: float) -> None:
    """From our prior, on the exported detections, at every instant: the same mean, to a share of its deviation."""
    motion = {"type": "ConstantVelocity", "acceleration_noise": 0.5}
    flight = flown(name, "circle", tracker={"type": kind, "motion": motion})
    period = flight.scenario.episode.period
    model = LinearGaussianTimeInvariantTransitionModel(
        transition_matrix=transition(period), covariance_matrix=process_noise(flight.scenario.tracker.motion, period)
    )
    predictor_of, updater_of, spread = FILTERS[kind]
    predictor, updater = predictor_of(model, **spread), updater_of(**spread)
    ours = track(flight, EPOCH)
    belief, gaps = ours[0], []
    for (time, heard), expected in zip(detections(flight, EPOCH)[1:], ours[1:], strict=True):
        belief = predictor.predict(belief, timestamp=time)
        for detection in sorted(heard, key=lambda one: one.metadata["sensor"]):
            belief = updater.update(SingleHypothesis(belief, detection))
        gaps.append(np.asarray(belief.mean - expected.mean, float)[:, 0] / np.sqrt(np.diag(expected.covar)))
    np.testing.assert_allclose(gaps, 0.0, atol=tolerance)


def test_sensor_models_differentiate_as_their_values_change() -> None:
    """The Jacobian is the slope of the function, by central differences."""
    flight = flown("BearingDoppler", "circle", **{"episode.steps": 12})
    _, heard = detections(flight, EPOCH)[5]
    (doppler,) = (detection for detection in heard if detection.metadata["kind"] == "Doppler")
    state, model = np.asarray(ground_truth(flight, EPOCH)[5].state_vector, float), doppler.measurement_model
    slopes = []
    for row, step in enumerate((10.0, 10.0, 0.1, 0.1)):
        shift = np.zeros((4, 1))
        shift[row] = step
        ahead, behind = (model.function(State(state + sign * shift))[0, 0] for sign in (1, -1))
        slopes.append((ahead - behind) / (2.0 * step))
    np.testing.assert_allclose(model.jacobian(State(state))[0], slopes, rtol=1e-6, atol=1e-10)


def test_sensor_models_draw_noise_of_their_own_size() -> None:
    flight = flown("BearingDoppler", "circle", **{"episode.steps": 12})
    (doppler,) = (one for one in detections(flight, EPOCH)[5][1] if one.metadata["kind"] == "Doppler")
    model, state = doppler.measurement_model, ground_truth(flight, EPOCH)[5]
    noise = np.asarray(model.rvs(4000, random_state=np.random.RandomState(0)), float)
    assert noise.std() == pytest.approx(math.sqrt(model.covar()[0, 0]), rel=5.0 / math.sqrt(2 * 4000))
    shifted = model.function(state, noise=noise[:, :1]) - model.function(state)
    np.testing.assert_allclose(np.asarray(shifted, float), noise[:, :1], rtol=1e-9)
