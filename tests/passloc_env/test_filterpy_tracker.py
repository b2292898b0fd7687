"""FilterPy's filters as the tracker inside: equal to ours where both exist, and never the end of an episode."""

from dataclasses import dataclass

import numpy as np
import pytest

from passloc_env import SCENARIOS, LocalisationEnv, Scenario
from passloc_env.angles import bearing_of
from passloc_env.distributions import Uniform
from passloc_env.linalg import diagonal
from passloc_env.motion import UnknownTurn
from passloc_env.simulation import Simulation
from passloc_env.tracking import FilterPyTracker, Tracker, UnscentedKalman
from passloc_env.tracking.filterpy_tracker import FilterPyTrack

pytest.importorskip("filterpy")

UNSCENTED, CUBATURE, EXTENDED = "UnscentedKalmanFilter", "CubatureKalmanFilter", "ExtendedKalmanFilter"
PAIR = np.array([[0.5, -0.3]])
"""Actions of two environments: across the line of sight, to either side."""


def with_tracker(scenario: Scenario, **fields) -> Scenario:
    """The scenario with FilterPy inside, believing the same motion."""
    return scenario.replace(tracker=FilterPyTracker(motion=scenario.tracker.motion, **fields))


@pytest.mark.parametrize("name", ["BearingsOnly", "BearingDoppler", "BearingDopplerUnknownCarrier"])
def test_unscented_equals_ours(name, begin):
    """Over 240 steps, each a prediction and an update, relative to range, speed and standard deviations.

    1e-9: rounding, about 1e-13 per step, grows along the unobservable range before the first turn.
    """
    ours = begin(SCENARIOS[name], 2)
    theirs = begin(with_tracker(SCENARIOS[name]), 2)
    scale = np.sqrt(diagonal(ours.track.covariance))
    for decision in range(60):
        for simulation in (ours, theirs):
            simulation.step(PAIR * (-1.0) ** (decision // 10))
        sigma = np.sqrt(diagonal(ours.track.covariance))
        assert (np.abs(theirs.track.mean - ours.track.mean) <= 1e-9 * scale).all()
        difference = theirs.track.covariance - ours.track.covariance
        assert (np.abs(difference) <= 1e-9 * (sigma[:, None] * sigma[None])).all()
        np.testing.assert_allclose(theirs.track.nis, ours.track.nis, rtol=1e-6, atol=1e-9)
    assert ours.step_count.tolist() == [240, 240]
    assert not theirs.track.repairs.any()


@pytest.mark.parametrize("filter_", [UNSCENTED, CUBATURE, EXTENDED])
def test_bearings_across_the_seam_are_no_jump(filter_, begin):
    """Emitters that creep across due south, where 180° is −180°; half a turn away all is equal but for the jump."""
    scenario = with_tracker(SCENARIOS["BearingsOnly"], filter=filter_).override({"platforms.0.speed": 0.0})
    slow, gaps = {"target.start.speed": 10.0}, []
    south = begin(scenario.override(slow | {"target.start.bearing": 3.139, "target.start.course": -np.pi / 2}), 8)
    north = begin(
        scenario.override(slow | {"target.start.bearing": 3.139 - np.pi, "target.start.course": np.pi / 2}), 8
    )
    update = south.track.update

    def watched(measurement, *rest):
        gaps.append(measurement[0] - bearing_of(south.track.mean[:2]))
        update(measurement, *rest)

    south.track.update = watched
    for _ in range(10):
        south.step(np.zeros((1, 8)))
        north.step(np.zeros((1, 8)))
        # A centimetre at 40 km: roundings grow along the unobservable range.
        np.testing.assert_allclose(south.track.mean, -north.track.mean, rtol=0, atol=1e-2)
    # Belief and measurement were on different sides of the seam, either way round.
    assert np.min(gaps) < -6.0
    assert np.max(gaps) > 6.0


@pytest.mark.parametrize("parameters", [{"alpha": 0.5, "beta": 1.0, "kappa": 0.5}, {"kappa": -1.0}])
def test_sigma_point_parameters_reach_the_filter(parameters, begin):
    scenario = SCENARIOS["BearingsOnly"]
    motion = scenario.tracker.motion
    ours = begin(scenario.replace(tracker=UnscentedKalman(motion=motion, **parameters)), 2)
    theirs = begin(with_tracker(scenario, **parameters), 2)
    default = begin(with_tracker(scenario), 2)
    for simulation in (ours, theirs, default):
        for _ in range(3):
            simulation.step(PAIR)
    np.testing.assert_allclose(theirs.track.mean, ours.track.mean, rtol=1e-9)
    assert np.abs(default.track.mean - ours.track.mean).max() > 1e-3


def test_extended_is_the_textbook_filter(begin):
    """``K = P Hᵀ (H P Hᵀ + R)⁻¹``, written out for one bearing."""
    simulation = begin(with_tracker(SCENARIOS["BearingsOnly"], filter=EXTENDED), 1)
    track, update = simulation.track, simulation.track.update
    compared = []

    def checked(measurement, poses, detected=None):
        mean, covariance = track.mean[:, 0].copy(), track.covariance[..., 0].copy()
        update(measurement, poses, detected)
        east, north = mean[:2] - poses[0].position[:, 0]
        slope = np.array([north, -east, 0.0, 0.0]) / (east**2 + north**2)
        innovation = np.angle(np.exp(1j * (measurement[0, 0] - np.arctan2(east, north))))
        gain = covariance @ slope / (slope @ covariance @ slope + 3e-3**2)
        np.testing.assert_allclose(track.mean[:, 0], mean + gain * innovation, rtol=1e-9)
        expected = covariance - np.outer(gain, slope @ covariance)
        sigma = np.sqrt(np.diag(expected))
        np.testing.assert_allclose(track.covariance[..., 0] / sigma / sigma[:, None], expected / sigma / sigma[:, None])
        compared.append(innovation)

    track.update = checked
    for _ in range(5):
        simulation.step(PAIR[:, :1])
    assert len(compared) == 20


@pytest.mark.parametrize("filter_", [UNSCENTED, CUBATURE, EXTENDED])
@pytest.mark.parametrize("name", ["BearingsOnly", "BearingDopplerUnknownCarrier"])
def test_every_filter_localises(name, filter_, begin):
    """A manoeuvre brings each within a tenth of the range, with no repair and a covariance that is one."""
    simulation = begin(with_tracker(SCENARIOS[name], filter=filter_), 2, first_seed=20)
    before = simulation.outcome.relative_range_error.copy()
    for decision in range(40):
        simulation.step(PAIR * (-1.0) ** (decision // 8))
        covariance = simulation.track.covariance
        assert np.array_equal(covariance, covariance.swapaxes(0, 1))
        assert (np.linalg.eigvalsh(np.moveaxis(covariance, -1, 0)) > 0.0).all()
    assert (simulation.outcome.relative_range_error < 0.1).all()
    assert (simulation.outcome.relative_range_error < before).all()
    assert not simulation.track.repairs.any()


def test_missing_measurements_run_and_teach_nothing(begin):
    """Where the bearing is missed the belief stays the prediction, as with ours to 1e-9 of a standard deviation."""
    scenario = SCENARIOS["BearingDoppler"].override(
        {"sensors.Bearing.detection_probability": 0.5, "sensors.Doppler.detection_probability": 0.7}
    )
    ours, theirs = begin(scenario, 2), begin(with_tracker(scenario), 2)
    missed = []
    watched = theirs.track.update

    def update(measurement, poses, detected=None):
        missed.append(~detected)
        watched(measurement, poses, detected)

    theirs.track.update = update
    for _ in range(20):
        ours.step(PAIR)
        theirs.step(PAIR)
        sigma = np.sqrt(diagonal(ours.track.covariance))
        assert (np.abs(theirs.track.mean - ours.track.mean) <= 1e-9 * sigma).all()
    share = np.mean(missed, axis=(0, 2))
    assert 0.2 < share[1] < 0.4 < share[0] < 0.6
    assert any(row.all(axis=0).any() for row in missed)
    assert not theirs.track.repairs.any()


@pytest.mark.parametrize("filter_", [CUBATURE, EXTENDED])
def test_missing_measurements_run_in_every_filter(filter_):
    changes = {"sensors.0.detection_probability": 0.5, "episode.steps": 40}
    env = LocalisationEnv(with_tracker(SCENARIOS["BearingsOnly"], filter=filter_), overrides=changes, diagnostics=True)
    env.reset(seed=1)
    for _ in range(10):
        observation, *_, truncated, info = env.step(np.array([0.5]))
        assert np.isfinite(observation).all()
        assert info["repairs"] == 0
    assert truncated


@dataclass(frozen=True, kw_only=True)
class OwnFilter(FilterPyTracker):
    """A user's tracker: the unscented filter with doubled measurement noise."""

    def create(self, states, scalars, period, calls):
        filter_ = super().create(states, scalars, period, calls)
        update = filter_.update
        filter_.update = lambda z, R: update(z, R=4.0 * R)
        return filter_


def test_a_filter_of_ones_own(begin):
    """Double the noise inside is double the noise outside, as far as the filter can tell."""
    scenario = SCENARIOS["BearingsOnly"]
    motion = scenario.tracker.motion
    own = begin(scenario.replace(tracker=OwnFilter(motion=motion)))
    stock = begin(with_tracker(scenario))
    own.step(PAIR[:, :1])
    stock.step(PAIR[:, :1])
    bearing = np.array([[np.cos(b := own.belief.bearing[0]), -np.sin(b)]])
    across = [(bearing @ s.track.covariance[:2, :2, 0] @ bearing.T).item() for s in (own, stock)]
    # Variances with fourfold measurement noise are at most fourfold.
    assert 1.5 * across[1] < across[0] < 4.0 * across[1]


class Bare:
    """A filter with no more than the documentation asks for: a Kalman step without innovation or its covariance."""

    def __init__(self, calls):
        self.x, self.P, self.Q = np.zeros(4), np.eye(4), np.eye(4)
        self._calls = calls

    def predict(self):
        F = self._calls.transition_matrix
        self.x, self.P = F @ self.x, F @ self.P @ F.T + self.Q

    def update(self, z, R):
        H = self._calls.jacobian(self.x)
        gain = np.linalg.solve(H @ self.P @ H.T + R, H @ self.P).T
        self.x = self.x + gain @ (z - self._calls.measure(self.x))
        self.P = self.P - gain @ H @ self.P


@dataclass(frozen=True, kw_only=True)
class BareFilter(FilterPyTracker):
    """Builds the above."""

    def create(self, states, scalars, period, calls):
        return Bare(calls)


def test_a_filter_that_does_not_say_what_it_expects_has_no_gate(begin, refusal):
    error = refusal(begin, SCENARIOS["BearingsOnly"].replace(tracker=BareFilter(gate=0.99)))
    assert (error.field, error.allowed) == ("gate", "must be 0: Bare has no innovation y with covariance S")


def test_a_filter_with_the_documented_interface_is_enough(begin):
    """``create`` asks for ``x``, ``P``, ``Q``, ``predict()`` and ``update(z, R=…)``, and for nothing else."""
    scenario = SCENARIOS["BearingsOnly"]
    bare = begin(scenario.replace(tracker=BareFilter(motion=scenario.tracker.motion)))
    extended = begin(with_tracker(scenario, filter=EXTENDED))
    for _ in range(5):
        bare.step(PAIR[:, :1])
        extended.step(PAIR[:, :1])
    np.testing.assert_allclose(bare.track.mean, extended.track.mean, rtol=1e-9)


class Failing:
    """Raises, or leaves nonsense behind, in one of its calls at the given step."""

    def __init__(self, filter_, fault, at):
        object.__setattr__(self, "_inside", (filter_, fault, at))
        object.__setattr__(self, "_calls", {"predict": 0, "update": 0})

    def __getattr__(self, name):
        return getattr(self._inside[0], name)

    def __setattr__(self, name, value):
        setattr(self._inside[0], name, value)

    def _call(self, name, *arguments, **named):
        filter_, fault, at = self._inside
        self._calls[name] += 1
        due = self._calls[name] == at
        if due and fault == name:
            raise np.linalg.LinAlgError("Matrix is not positive definite")
        getattr(filter_, name)(*arguments, **named)
        if due and name == "update" and fault == "nan":
            filter_.x = filter_.x * np.nan
        if due and name == "update" and fault == "singular":
            filter_.S = filter_.S * 0.0

    def predict(self):
        self._call("predict")

    def update(self, z, R):
        self._call("update", z, R=R)


@dataclass(frozen=True, kw_only=True)
class FailingFilter(FilterPyTracker):
    """The unscented filter, failing once in its seventh step."""

    fault = "update"
    created = 0

    def create(self, states, scalars, period, calls):
        type(self).created += 1
        return Failing(super().create(states, scalars, period, calls), self.fault, 7)


@pytest.mark.parametrize("fault", ["predict", "update", "nan", "singular"])
def test_a_broken_filter_starts_anew(fault, monkeypatch):
    """The episode goes on from the prior, with a fresh filter, and ``info`` counts the repair."""
    monkeypatch.setattr(FailingFilter, "fault", fault)
    monkeypatch.setattr(FailingFilter, "created", 0)
    scenario = SCENARIOS["BearingsOnly"]
    scenario = scenario.replace(tracker=FailingFilter(motion=scenario.tracker.motion)).override({"episode.steps": 60})
    env = LocalisationEnv(scenario, diagnostics=True, overrides={"episode.decision_every": 1})
    _, info = env.reset(seed=3)
    prior_trace = np.trace(info["covariance"][:2, :2])
    repairs, created, truncated = [], FailingFilter.created, False
    while not truncated:
        observation, _, terminated, truncated, info = env.step(np.array([0.5]))
        assert np.isfinite(observation).all()
        assert np.isfinite(info["covariance"]).all()
        assert not terminated
        repairs.append(info["repairs"])
        if len(repairs) == 7:
            # The range is unknown again: 15 km along, and 40 km times 3 mrad across.
            assert np.trace(info["covariance"][:2, :2]) == pytest.approx(prior_trace, rel=1e-6)
    assert repairs[:8] == [0] * 6 + [1, 1]
    assert FailingFilter.created > created
    assert len(repairs) == 60


def test_one_broken_filter_leaves_its_neighbours_alone(begin):
    scenario = SCENARIOS["BearingsOnly"]
    sound = begin(with_tracker(scenario), 2)
    mixed = begin(with_tracker(scenario), 2)
    filters = mixed.track._filters
    filters[1] = Failing(filters[1], "update", 3)
    for simulation in (sound, mixed):
        simulation.step(PAIR)
    assert mixed.track.repairs.tolist() == [0, 1]
    assert np.array_equal(mixed.track.mean[:, 0], sound.track.mean[:, 0])
    assert not np.array_equal(mixed.track.mean[:, 1], sound.track.mean[:, 1])


def test_state_is_restored_to_the_last_bit():
    """What a filter knows between two steps is mean and covariance, so a snapshot needs no more."""
    env = LocalisationEnv(with_tracker(SCENARIOS["BearingsOnly"]))
    env.reset(seed=0)
    env.step(np.array([0.5]))
    state = env.get_state()
    first = env.step(np.array([-0.5]))[0]
    env.step(np.array([0.2]))
    env.set_state(state)
    assert env.step(np.array([-0.5]))[0].tobytes() == first.tobytes()


def test_random_numbers_reach_every_filter():
    """Each environment's filter is built from its own episode's noise level."""
    changes = {"sensors.0.sigma": {"type": "Uniform", "low": 1e-3, "high": 1e-1}}
    simulations = []
    for scenario in (SCENARIOS["BearingsOnly"], with_tracker(SCENARIOS["BearingsOnly"])):
        simulation = Simulation(scenario.override(changes), 3)
        simulation.reset(np.arange(3), [np.random.default_rng(seed) for seed in range(3)])
        simulation.step(np.array([[0.5, -0.3, 0.1]]))
        simulations.append(simulation)
    ours, theirs = simulations
    np.testing.assert_allclose(theirs.track.mean, ours.track.mean, rtol=1e-9)


@pytest.mark.parametrize("filter_", [UNSCENTED, CUBATURE, EXTENDED])
def test_round_trip(filter_):
    scenario = with_tracker(SCENARIOS["BearingDoppler"], filter=filter_, alpha=0.7)
    again = Scenario.from_json(scenario.to_json())
    assert again == scenario
    assert isinstance(again.tracker, FilterPyTracker)
    assert (again.tracker.filter, again.tracker.alpha) == (filter_, 0.7)


def test_by_plain_data():
    env = LocalisationEnv(overrides={"tracker": {"type": "FilterPyTracker", "filter": EXTENDED}})
    assert env.reset(seed=0)[0].shape == env.observation_space.shape
    assert isinstance(env.scenario.tracker, Tracker)
    assert isinstance(env._batch_of_one.batch.tiles[0].track, FilterPyTrack)


def test_refusals(refusal, begin):
    error = refusal(lambda: FilterPyTracker(filter="UnscentedKalmanFliter"))
    assert "did you mean 'UnscentedKalmanFilter'" in error.allowed
    scenario = SCENARIOS["BearingsOnly"].replace(tracker=FilterPyTracker(motion=UnknownTurn(), filter=EXTENDED))
    with pytest.raises(TypeError, match="needs a linear motion"):
        begin(scenario)


def test_impossible_sigma_points_are_refused_as_in_our_filter(refusal, begin):
    for kind in (UnscentedKalman, FilterPyTracker):
        assert refusal(lambda kind=kind: kind(alpha=Uniform(low=0.5, high=1.0))).field == "alpha"
        spreadless = SCENARIOS["BearingsOnly"].replace(tracker=kind(kappa=-4.0))
        assert refusal(begin, spreadless).field == "kappa"
