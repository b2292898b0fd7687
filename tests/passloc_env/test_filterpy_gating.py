"""FilterPy's filters gate by what they themselves expect, and refuse what ours refuse."""

import numpy as np
import pytest

from passloc_env import SCENARIOS, Scenario
from passloc_env.linalg import diagonal
from passloc_env.tracking import ExtendedKalman, FilterPyTracker, UnscentedKalman

pytest.importorskip("filterpy")


def inside(scenario: Scenario, **fields) -> Scenario:
    """The scenario with FilterPy inside, believing the same motion."""
    return scenario.replace(tracker=FilterPyTracker(motion=scenario.tracker.motion, **fields))


@pytest.mark.parametrize(
    ("filter_", "kind"), [("UnscentedKalmanFilter", UnscentedKalman), ("ExtendedKalmanFilter", ExtendedKalman)]
)
def test_gates_are_ours(filter_, kind, begin):
    """Each sensor is refused where ours refuses it; the belief to 1e-6 of a standard deviation."""
    changes = {f"sensors.{i}.faults": {"outlier_probability": 0.2, "outlier_scale": 20.0} for i in range(2)}
    scenario = SCENARIOS["BearingDoppler"].override(changes | {"sensors.Bearing.detection_probability": 0.7})
    ours = begin(scenario.replace(tracker=kind(motion=scenario.tracker.motion, gate=0.95)), 2)
    theirs = begin(inside(scenario, filter=filter_, gate=0.95), 2)
    for _ in range(20):
        for simulation in (ours, theirs):
            simulation.step(np.array([[0.5, -0.3]]))
        np.testing.assert_array_equal(theirs.track.gated, ours.track.gated)
        sigma = np.sqrt(diagonal(ours.track.covariance))
        assert (np.abs(theirs.track.mean - ours.track.mean) <= 1e-6 * sigma).all()
    assert (theirs.track.gated > 10).all()
    assert not theirs.track.repairs.any()


def test_the_cubature_filter_gates_what_it_says_itself(begin):
    """A bearing ten of its own standard deviations off is refused and leaves the prediction; one of two is used."""
    scenario = inside(SCENARIOS["BearingsOnly"], filter="CubatureKalmanFilter", gate=0.99)
    simulation, twin = begin(scenario, 2), begin(scenario.override({"tracker.gate": 0.0}), 2).track
    track, poses = simulation.track, simulation.scene().poses
    for each in (track, twin):
        each.predict(simulation.time)
    mean, covariance = track.mean.copy(), track.covariance.copy()
    bearing = np.zeros((1, 2))
    twin.update(bearing, poses)
    expected = bearing - np.array([[f.y.item() for f in twin._filters]])
    sigma = np.sqrt([[f.S.item() for f in twin._filters]])
    track.update(expected + sigma * [10.0, 2.0], poses)
    assert track.gated.tolist() == [1, 0]
    np.testing.assert_allclose(track.mean[:, 0], mean[:, 0], rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(track.covariance[..., 0], covariance[..., 0], rtol=1e-6, atol=1e-6)
    assert np.linalg.det(track.covariance[..., 1]) < 0.5 * np.linalg.det(covariance[..., 1])
    assert track.nis[1] == pytest.approx(4.0, rel=1e-6)
