"""The tracker that crosses all bearings heard: against the fix of all rays at once, and against expectations."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest

from passloc_env.angles import bearing_of
from passloc_env.dynamics import Dynamics
from passloc_env.env import LocalisationEnv
from passloc_env.errors import ScenarioError
from passloc_env.layout import StateLayout
from passloc_env.motion import ConstantVelocity
from passloc_env.platforms import FixedStation, Pose
from passloc_env.scenario import Episode, Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite
from passloc_env.sensors import Bearing, Doppler
from passloc_env.simulation import Simulation
from passloc_env.target import CartesianStart, Target
from passloc_env.tracking import PlacePrior, RecursiveCrossFix, StatePrior
from passloc_env.tracking.cross_fix import Fix, positive_range_fix
from passloc_env.tracking.recursive_cross_fix import CrossFixTrack
from passloc_env.tracking.tracker import Models

SIDE, SPREAD = 1e3, 300.0
WIDE = math.radians(45.0) / math.sqrt(3.0)
"""Standard deviation of errors that are uniform within 45°."""

CENTRE = np.array([[0.5 * SIDE], [0.5 * SIDE]])
EVERYBODY: Any = slice(None)


def track_of(
    tracker: RecursiveCrossFix, size: int, stations: int = 3, sigma: Any = WIDE, lever_arm: tuple[float, ...] = ()
) -> CrossFixTrack:
    """A track begun at the centre of the square, known to 300 m per axis."""
    sensors = tuple(
        Bearing(sigma=sigma, platform=index, noise_law="uniform", lever_arm=lever_arm) for index in range(stations)
    )
    layout = StateLayout()
    track = tracker.build(Models(layout, Dynamics(ConstantVelocity(), layout, 1.0), SensorSuite(sensors)), size)
    covariance = np.diag([SPREAD**2, SPREAD**2, 1e-6, 1e-6])[..., None]
    track.start(np.arange(size), np.concatenate([CENTRE, 0.0 * CENTRE]) * np.ones(size), covariance * np.ones(size))
    return track


def feed(
    track: CrossFixTrack, stations: np.ndarray, bearings: np.ndarray, heard: np.ndarray | None = None
) -> CrossFixTrack:
    """Let a track hear looks ``(K, M, N)`` from stations ``(2, K, M, N)``."""
    for k, look in enumerate(bearings):
        track.predict(np.full(look.shape[-1], float(k)))
        poses = [Pose(place, 0.0 * place) for place in np.moveaxis(stations[:, k], 1, 0)]
        track.update(look, poses, None if heard is None else heard[k])
    return track


def looks(count: int, size: int, seed: int, stations: int = 3, error: float = math.radians(45.0)) -> Any:
    """Emitters ``(2, N)`` in the square, stations on the way and their bearings with uniform errors."""
    rng = np.random.default_rng(seed)
    emitter = rng.uniform(0.1 * SIDE, 0.9 * SIDE, (2, size))
    places = rng.uniform(0.0, SIDE, (2, count, stations, size))
    bearings = bearing_of(emitter[:, None, None] - places) + rng.uniform(-error, error, places.shape[1:])
    return emitter, places, bearings


def fix_of(stations: np.ndarray, bearings: np.ndarray, weight: float = 0.0) -> Fix:
    """All rays ``(K, M, N)`` crossed at once, with a pull to the prior's centre."""
    size = bearings.shape[-1]
    pull = (CENTRE * np.ones(size), np.full(size, weight))
    return positive_range_fix(stations.reshape(2, -1, size), bearings.reshape(-1, size), pull)


@pytest.mark.parametrize("weight", [1e-9, 0.5, 7.0])
def test_without_compensation_it_is_the_fix_of_all_rays(weight: float) -> None:
    """After every look; the prior pulls as so many rays do."""
    _, stations, bearings = looks(6, 200, seed=0)
    track = track_of(RecursiveCrossFix(compensated=False, prior_rays=weight), 200)
    for k in range(6):
        feed(track, stations[:, k : k + 1], bearings[k : k + 1])
        fix = fix_of(stations[:, : k + 1], bearings[: k + 1], weight)
        np.testing.assert_allclose(track.mean[:2], fix.position, atol=1e-9 * SIDE)
        rays = 3 * (k + 1) + weight
        scale = (fix.residual + weight * SPREAD**2) / rays
        expected = scale[:, None, None] * np.linalg.inv(np.moveaxis(fix.information, -1, 0))
        np.testing.assert_allclose(np.moveaxis(track.covariance[:2, :2], -1, 0), expected, rtol=1e-6, atol=1e-6)


def test_through_the_simulation(begin: Callable[..., Simulation]) -> None:
    """The scenario's own vehicles and errors: what was measured at each step, crossed at once."""
    tracker = RecursiveCrossFix(compensated=False, prior_rays=1e-9)
    simulation = begin(SCENARIOS["CrossFix"].override({"tracker": tracker, "episode.steps": 20}), 50)
    heard: list[tuple[np.ndarray, np.ndarray]] = []

    def watch(seen: Simulation) -> None:
        places = np.stack([pose.position.copy() for pose in seen.poses()], axis=1)
        heard.append((places, seen.measure(seen.scene())[0]))
        stations = np.stack([look[0] for look in heard], axis=1)
        bearings = np.stack([look[1] for look in heard])
        np.testing.assert_allclose(seen.track.mean[:2], fix_of(stations, bearings, 1e-9).position, atol=1e-9 * SIDE)

    simulation.watchers.append(watch)
    rng = np.random.default_rng(4)
    for _ in range(4):
        simulation.step(rng.uniform(-1.0, 1.0, (3, 50)))
    assert len(heard) == 20


@pytest.mark.parametrize("compensated", [False, True])
def test_the_memory_forgets_the_oldest_looks(compensated: bool) -> None:
    _, stations, bearings = looks(11, 50, seed=1)
    short = feed(track_of(RecursiveCrossFix(memory=4, compensated=compensated), 50), stations, bearings)
    fresh = feed(track_of(RecursiveCrossFix(compensated=compensated), 50), stations[:, -4:], bearings[-4:])
    np.testing.assert_allclose(short.mean, fresh.mean, atol=1e-9 * SIDE)  # sums in another order
    np.testing.assert_allclose(short.covariance, fresh.covariance, rtol=1e-9, atol=1e-9)
    whole = feed(track_of(RecursiveCrossFix(compensated=compensated), 50), stations, bearings)
    assert np.abs(whole.mean - fresh.mean).max() > 1.0


@pytest.mark.parametrize("compensated", [False, True])
def test_what_is_not_detected_is_not_crossed(compensated: bool) -> None:
    """Rubbish where nothing was heard changes nothing; the rest is crossed as if it were all there had been."""
    rng = np.random.default_rng(2)
    _, stations, bearings = looks(7, 40, seed=2)
    heard = rng.random(bearings.shape) < 0.5
    tracker = RecursiveCrossFix(compensated=compensated)
    rubbish = np.where(heard, bearings, 99.0)
    found = feed(track_of(tracker, 40), stations, rubbish, heard)
    for column in range(40):
        rays = np.nonzero(heard[..., column])
        one_by_one = track_of(tracker, 1, stations=1)
        feed(one_by_one, stations[:, *rays, column][:, :, None, None], bearings[*rays, column][:, None, None])
        np.testing.assert_allclose(found.mean[:, column], one_by_one.mean[:, 0], atol=1e-9 * SIDE)
        np.testing.assert_allclose(found.covariance[..., column], one_by_one.covariance[..., 0], rtol=1e-9, atol=1e-9)


def test_nothing_heard_leaves_the_prior_s_centre() -> None:
    _, stations, bearings = looks(3, 5, seed=3)
    track = feed(track_of(RecursiveCrossFix(), 5), stations, bearings, np.zeros(bearings.shape, bool))
    np.testing.assert_array_equal(track.mean[:2], CENTRE * np.ones(5))
    assert (np.linalg.eigvalsh(np.moveaxis(track.covariance, -1, 0)) > 0.0).all()


@pytest.mark.parametrize("compensated", [False, True])
def test_exact_bearings_give_the_exact_place(compensated: bool) -> None:
    """Errors of a microradian are expected: they pull by 1e-12 of a kilometre, as little as the prior does."""
    emitter, stations, bearings = looks(5, 100, seed=4, error=0.0)
    tracker = RecursiveCrossFix(compensated=compensated, prior_rays=1e-9)
    track = feed(track_of(tracker, 100, sigma=1e-6), stations, bearings)
    np.testing.assert_allclose(track.mean[:2], emitter, atol=1e-6)
    np.testing.assert_array_equal(track.mean[2:], 0.0)
    np.testing.assert_allclose(track.covariance[[2, 3], [2, 3]], 1e-6)


def test_compensation_takes_the_stations_pull_back() -> None:
    """From fixed stations the pull stays however long one listens, while scatter falls with the root of the looks.

    With 60 looks at three stations the median errors are about 160 m and 60 m. Medians of 800 errors are good to 4 %:
    a factor of two is four standard deviations of the ratio away, one false alarm in 30 000.
    """
    rng = np.random.default_rng(6)
    emitter = rng.uniform(0.1 * SIDE, 0.9 * SIDE, (2, 800))
    first = rng.uniform(0.0, SIDE, (3, 800))
    nothing = np.zeros(800)
    stations = np.stack([[first[0], nothing], [nothing, first[1]], [nothing + SIDE, first[2]]], axis=1)
    places = np.repeat(stations[:, None], 60, axis=1)
    error = rng.uniform(-math.radians(45.0), math.radians(45.0), places.shape[1:])
    bearings = bearing_of(emitter[:, None, None] - places) + error
    median = {}
    for compensated in (False, True):
        track = feed(track_of(RecursiveCrossFix(compensated=compensated), 800), places, bearings)
        median[compensated] = float(np.median(np.linalg.norm(track.mean[:2] - emitter, axis=0)))
    assert median[False] > 2.0 * median[True]


def errors_made(sensor: Bearing, begin: Callable[..., Simulation]) -> np.ndarray:
    """Errors of a fixed station's bearings, as simulated: 100 000."""
    scenario = Scenario(
        target=Target(start=CartesianStart(position=(300.0, 400.0), velocity=(0.0, 0.0))),
        platforms=(FixedStation(),),
        sensors=(sensor,),
        prior=PlacePrior(position=(300.0, 300.0), position_sigma=300.0, velocity_sigma=1e-3),
        tracker=RecursiveCrossFix(memory=1),
        episode=Episode(steps=200, min_range=0.0, early_end=False),
    )
    simulation = begin(scenario, 500)
    made: list[np.ndarray] = []
    simulation.watchers.append(lambda seen: made.append(seen.measure(seen.scene())[0][0]))
    for _ in range(50):
        simulation.step(np.zeros((0, 500)))
    return np.concatenate(made) - math.atan2(300.0, 400.0)


@pytest.mark.parametrize("law", ["gaussian", "uniform"])
@pytest.mark.parametrize("sigma", [0.02, WIDE, 0.7])
def test_expected_normals(law: str, sigma: float, begin: Callable[..., Simulation]) -> None:
    """``E n nᵀ = (1 − 2b) n₀n₀ᵀ + b I`` with ``b = E sin² δ``, by the errors that the simulation makes.

    Five standard deviations of means over 100 000 errors: one false alarm in a million per number.
    """
    sensor = Bearing(sigma=sigma, noise_law=law)
    error, b = errors_made(sensor, begin), sensor.mean_squared_sine
    assert len(error) == 100_000
    squares = np.square(np.sin(error))
    assert abs(squares.mean() - b) < 5.0 * squares.std() / math.sqrt(len(error))
    true = math.atan2(300.0, 400.0)
    normal, expected = np.stack([np.cos(true + error), -np.sin(true + error)]), np.array([0.8, -0.6])
    outer = normal[:, None] * normal
    gap = outer.mean(axis=-1) - (1.0 - 2.0 * b) * np.outer(expected, expected) - b * np.eye(2)
    assert (np.abs(gap) < 5.0 * outer.std(axis=-1) / math.sqrt(len(error)) + 1e-12).all()


@pytest.mark.parametrize("law", ["gaussian", "uniform"])
def test_mean_squared_sine_of_small_errors_is_the_variance(law: str) -> None:
    """To the next order, ``E δ⁴/3`` at most ``σ⁴``; and sigma may differ between environments."""
    sigma = np.array([1e-4, 1e-3, 1e-2])
    sensor = Bearing(sigma=0.01, noise_law=law)
    object.__setattr__(sensor, "sigma", sigma)
    np.testing.assert_allclose(sensor.mean_squared_sine, sigma**2, rtol=2e-4)


@pytest.mark.parametrize(("error", "away"), [(math.radians(45.0), 0.0), (0.3, 3e3)], ids=["crossing", "along"])
def test_what_is_taken_back(error: float, away: float) -> None:
    """In plain matrices: each station's own pull where its ray is ahead, carefully, and no more than is bearable.

    Rays that run along each other from afar can bear little; some of those that cross point away from the fix.
    """
    sigmas, size = np.array([0.5, 0.2, 0.4]), 60
    emitter, stations, _ = looks(4, size, seed=7)
    stations[0] -= away
    noise = np.random.default_rng(7).uniform(-error, error, stations.shape[1:])
    bearings = bearing_of(emitter[:, None, None] - stations) + noise
    track = track_of(RecursiveCrossFix(), size)
    sensors = tuple(Bearing(sigma=float(sigma), platform=index) for index, sigma in enumerate(sigmas))
    track.models = Models(track.models.layout, track.models.dynamics, SensorSuite(sensors))
    feed(track, stations, bearings)
    fix = fix_of(stations, bearings, 0.5)
    each = np.tile(0.5 * (1.0 - np.exp(-2.0 * sigmas**2)), 4)[:, None] * fix.active
    limited = 0
    for column in range(size):
        normal, places = fix.information[..., column], stations.reshape(2, -1, size)[..., column]
        pulls, rays = each[:, column], fix.active[:, column].sum()
        wanted, bearable = pulls.sum() * rays / (rays + 6.0), 0.5 * np.linalg.eigvalsh(normal)[0]
        limited += bearable < wanted
        weights = pulls / pulls.sum() * min(wanted, bearable)
        right = normal @ fix.position[:, column] - places @ weights
        expected = np.linalg.solve(normal - weights.sum() * np.eye(2), right)
        # Half of the smallest eigenvalue is left, some thousandth of the largest.
        np.testing.assert_allclose(track.mean[:2, column], expected, atol=1e-6)
    assert limited == size if away else limited == 0
    assert fix.active.all() == bool(away)


def hard_looks() -> dict[str, tuple[np.ndarray, np.ndarray]]:
    """Looks ``(2, K, M, N)``, ``(K, M, N)`` that leave a fix undetermined, or all but."""
    _, places, bearings = looks(5, 300, seed=8)
    one = np.broadcast_to(places[:, :1, :1], places.shape).copy()
    return {
        "wide errors": (places, bearings),
        "one station": (one[:, :, :1], bearings[:, :1]),
        "all in one place": (one, bearings),
        "all in the prior's centre": (np.broadcast_to(CENTRE[..., None, None], places.shape).copy(), bearings),
        "all parallel": (places, np.broadcast_to(bearings[:1, :1], bearings.shape).copy()),
        "one bearing from one place": (one, np.broadcast_to(bearings[:1, :1], bearings.shape).copy()),
        "away from each other": (places, bearing_of(places - CENTRE[..., None, None])),
        "far away": (1e9 + places, bearings),
    }


@pytest.mark.parametrize("compensated", [False, True])
@pytest.mark.parametrize("weight", [1e-9, 1e-6, 0.5])
@pytest.mark.parametrize(("places", "bearings"), hard_looks().values(), ids=list(hard_looks()))
def test_covariance_is_sound(places: np.ndarray, bearings: np.ndarray, weight: float, compensated: bool) -> None:
    track = track_of(RecursiveCrossFix(compensated=compensated, prior_rays=weight), 300, stations=places.shape[2])
    for k in range(len(bearings)):
        feed(track, places[:, k : k + 1], bearings[k : k + 1])
        assert np.isfinite(track.mean).all()
        np.testing.assert_array_equal(track.covariance, track.covariance.swapaxes(0, 1))
        assert (np.linalg.eigvalsh(np.moveaxis(track.covariance[:2, :2], -1, 0)) > 0.0).all()


def test_one_station_by_hand() -> None:
    """Eight equal rays and a prior worth half of one: along the ray the prior alone decides, across it both."""
    places, bearings = np.zeros((2, 8, 1, 1)), np.full((8, 1, 1), math.atan2(3.0, 4.0))
    track = feed(track_of(RecursiveCrossFix(compensated=False), 1, stations=1), places, bearings)
    along, across = np.array([0.6, 0.8]), np.array([0.8, -0.6])
    ahead, aside = along @ CENTRE[:, 0], 0.5 / 8.5 * (across @ CENTRE[:, 0])
    np.testing.assert_allclose(track.mean[:2, 0], ahead * along + aside * across, rtol=1e-12)
    missed = across @ CENTRE[:, 0] - aside
    variance = (8.0 * aside**2 + 0.5 * missed**2 + 0.5 * SPREAD**2) / 8.5
    expected = variance * (np.outer(along, along) / 0.5 + np.outer(across, across) / 8.5)
    np.testing.assert_allclose(track.covariance[:2, :2, 0], expected, rtol=1e-9)


def test_predicting_and_hearing_leave_the_rest_alone() -> None:
    """The emitter stays: velocities keep the prior's belief, and there is no innovation to speak of."""
    _, stations, bearings = looks(4, 3, seed=9)
    track = feed(track_of(RecursiveCrossFix(), 3), stations, bearings)
    before = track.mean.copy(), track.covariance.copy()
    track.predict(np.full(3, 4.0))
    for found, kept in zip((track.mean, track.covariance), before, strict=True):
        np.testing.assert_array_equal(found, kept)
    np.testing.assert_array_equal(track.mean[2:], 0.0)
    np.testing.assert_array_equal(track.covariance[2:], np.eye(4)[2:, :, None] * np.full(3, 1e-6))
    np.testing.assert_array_equal([track.nis, track.repairs], 0.0)


def test_starting_again_forgets_what_was_heard() -> None:
    """In the environments that begin anew; the others go on."""
    _, stations, bearings = looks(9, 4, seed=10)
    track = feed(track_of(RecursiveCrossFix(memory=5), 4), stations[:, :6], bearings[:6])
    mean, covariance = np.array([[100.0], [900.0], [0.0], [0.0]]), 1e4 * np.eye(4)[..., None]
    again = np.array([1, 3])
    track.start(again, mean * np.ones(2), covariance * np.ones(2))
    np.testing.assert_array_equal(track.mean[:, again], mean * np.ones(2))
    feed(track, stations[:, 6:], bearings[6:])
    new = track_of(RecursiveCrossFix(memory=5), 4)
    new.start(np.arange(4), mean * np.ones(4), covariance * np.ones(4))
    feed(new, stations[:, 6:], bearings[6:])
    kept = feed(track_of(RecursiveCrossFix(memory=5), 4), stations, bearings)
    for found, fresh, old in ((track.mean, new.mean, kept.mean), (track.covariance, new.covariance, kept.covariance)):
        np.testing.assert_array_equal(found[..., again], fresh[..., again])
        np.testing.assert_array_equal(found[..., [0, 2]], old[..., [0, 2]])


def test_bearings_are_heard_where_the_sensor_sits() -> None:
    _, stations, bearings = looks(4, 20, seed=11)
    arm = np.array([30.0, -50.0])
    mounted = feed(track_of(RecursiveCrossFix(), 20, lever_arm=tuple(arm)), stations, bearings)
    moved = feed(track_of(RecursiveCrossFix(), 20), stations + arm[:, None, None, None], bearings)
    np.testing.assert_allclose(mounted.mean, moved.mean, atol=1e-9 * SIDE)


@pytest.mark.parametrize("compensated", [False, True])
def test_bits_do_not_depend_on_the_batch(compensated: bool, assert_batch_free: Callable[..., None]) -> None:
    _, stations, bearings = looks(9, 60, seed=12)
    heard = np.random.default_rng(12).random(bearings.shape) < 0.8

    def localise(places: np.ndarray, angles: np.ndarray, detected: np.ndarray) -> np.ndarray:
        tracker = RecursiveCrossFix(memory=6, compensated=compensated)
        track = feed(track_of(tracker, angles.shape[-1]), places, angles, detected)
        return np.concatenate([track.mean[:, None], track.covariance], axis=1)

    assert_batch_free(localise, stations, bearings, heard)


def test_a_snapshot_brings_the_rays_back() -> None:
    """Taken when the ring has gone round, and put back into a world that has heard other rays."""
    changes = {"tracker.memory": 7}
    env, other = (LocalisationEnv("CrossFix", overrides=changes, diagnostics=True) for _ in range(2))
    env.reset(seed=1)
    other.reset(seed=2)
    rng = np.random.default_rng(0)
    for _ in range(4):
        env.step(rng.uniform(-1.0, 1.0, 3))
    state, actions = env.get_state(), rng.uniform(-1.0, 1.0, (4, 3))
    expected = [env.step(action) for action in actions]
    for world in (env, other):
        world.set_state(state)
        for action, (observation, reward, *_, info) in zip(actions, expected, strict=True):
            found = world.step(action)
            np.testing.assert_array_equal(found[0], observation)
            assert found[1] == reward
            np.testing.assert_array_equal(found[4]["covariance"], info["covariance"])


SPACE = {
    "target.start": CartesianStart(position=(1e4, 0.0, 1e3), velocity=(0.0, 0.0, 0.0)),
    "platforms": [FixedStation(position=(0.0, 0.0, 0.0))],
    "sensors": [Bearing(sigma=0.01)],
    "prior": StatePrior(position_sigma=1e3, velocity_sigma=1.0),
}


@pytest.mark.parametrize(
    ("changes", "found"),
    [
        ({"sensors": [Bearing(sigma=0.01), Doppler(sigma=1.0, carrier=1e9)]}, "Doppler"),
        ({"sensors": [Doppler(sigma=1.0, carrier=1e9), Bearing(sigma=0.01)], "prior.sensor": 1}, "Doppler"),
        (SPACE, "3 axes"),
    ],
)
def test_refuses_what_it_cannot_cross(
    changes: dict[str, Any], found: str, refusal: Callable[..., ScenarioError]
) -> None:
    error = refusal(Scenario().override, {**changes, "tracker": RecursiveCrossFix()})
    assert (error.field, error.value) == ("tracker", found)
    assert "Bearing sensors in the plane" in error.allowed


@pytest.mark.parametrize(("field", "value"), [("memory", 0), ("prior_rays", 0.0), ("prior_rays", 1e-10)])
def test_impossible_settings(field: str, value: float, refusal: Callable[..., ScenarioError]) -> None:
    error = refusal(SCENARIOS["CrossFix"].override, {f"tracker.{field}": value})
    assert (error.field, error.value) == (f"tracker.{field}", value)
