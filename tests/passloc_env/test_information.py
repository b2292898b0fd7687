"""The Cramér–Rao bound and the Gram gain against their definitions, and against published numbers."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from scipy.linalg import block_diag

from passloc_env.dynamics import Dynamics
from passloc_env.faults import SOUND
from passloc_env.information import Information, sigma_along
from passloc_env.layout import StateLayout
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, LinearMotion
from passloc_env.nuisance import Nuisance
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensor_suite import SensorSuite
from passloc_env.simulation import Simulation

ENVIRONMENTS, STEPS, PERIOD = 3, 25, 2.0
WALK = (Nuisance("carrier_offset", 3.0, 0.2),)

MOTIONS = {
    "CV": ConstantVelocity(acceleration_noise=0.3),
    "CV, continuous": ConstantVelocity(acceleration_density=0.5),
    "CV, no noise": ConstantVelocity(),
    "CA": ConstantAcceleration(acceleration_noise=0.1),
    "CT": CoordinatedTurn(turn_rate=0.1, acceleration_noise=0.2),
}
WITHOUT_NOISE = {name: motion for name, motion in MOTIONS.items() if "no noise" in name}


class Noise:
    """A sensor of which only the noise matters."""

    size, angular, detection_probability, faults = 2, (False, False), 1.0, SOUND

    def __init__(self, covariance: np.ndarray) -> None:
        self.covariance = covariance

    def noise_covariance(self) -> np.ndarray:
        return self.covariance


class Run:
    """A random history: two correlated measurements a step of every state, some of them missed."""

    def __init__(self, motion: LinearMotion, nuisances: tuple[Nuisance, ...] = (), missing: float = 0.0) -> None:
        rng = np.random.default_rng(0)
        layout = motion.layout(2).with_nuisance(tuple(nuisance.name for nuisance in nuisances))
        self.dynamics = Dynamics(motion, layout, PERIOD, nuisances)
        n = layout.size
        root, mix = rng.normal(size=(n, n, ENVIRONMENTS)), rng.normal(size=(2, 2, ENVIRONMENTS))
        self.prior = np.einsum("ikN,jkN->ijN", root, root) + np.eye(n)[..., None]
        self.noise = np.einsum("ikN,jkN->ijN", mix, mix) + np.eye(2)[..., None]
        if missing:  # sensors that may miss alone have noises of their own
            self.noise *= np.eye(2)[..., None]
        self.suite = SensorSuite((Noise(self.noise),))
        self.jacobians = rng.normal(size=(STEPS, 2, n, ENVIRONMENTS))
        self.detected = rng.random((STEPS, 2, ENVIRONMENTS)) >= missing

    def information(self) -> Information:
        information = Information(self.dynamics, ENVIRONMENTS)
        information.start(np.arange(ENVIRONMENTS), self.prior)
        return information

    def columns(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]]:
        """F, Q, R, prior and the jacobians of each environment, as plain matrices."""
        transition, noise = self.dynamics.transition.matrix[..., 0], self.dynamics.process_noise[..., 0]
        return [
            (
                transition,
                noise,
                self.noise[..., c],
                self.prior[..., c],
                self.jacobians[..., c] * self.detected[..., None, c],
            )
            for c in range(ENVIRONMENTS)
        ]


@pytest.fixture(params=[(), WALK], ids=["", "walking nuisance"])
def nuisances(request: pytest.FixtureRequest) -> tuple[Nuisance, ...]:
    found: tuple[Nuisance, ...] = request.param
    return found


@pytest.mark.parametrize("missing", [0.0, 0.4])
@pytest.mark.parametrize("motion", MOTIONS.values(), ids=list(MOTIONS))
def test_bound_is_the_information_recursion(
    motion: LinearMotion, nuisances: tuple[Nuisance, ...], missing: float
) -> None:
    """``J ← (Q + F J⁻¹ Fᵀ)⁻¹ + Hᵀ R⁻¹ H``, with rows that were not detected left out of H."""
    run = Run(motion, nuisances, missing)
    information, expected = run.information(), [np.linalg.inv(prior) for *_, prior, _ in run.columns()]
    for step in range(STEPS):
        information.advance()
        information.absorb(run.jacobians[step], run.suite, run.detected[step] if missing else None)
        for column, (transition, noise, r, _, jacobians) in enumerate(run.columns()):
            spread = noise + transition @ np.linalg.inv(expected[column]) @ transition.T
            expected[column] = np.linalg.inv(spread) + jacobians[step].T @ np.linalg.inv(r) @ jacobians[step]
            bound = np.linalg.inv(expected[column])
            # Both carry condition numbers up to 1e6.
            np.testing.assert_allclose(
                information.bound[..., column], bound, rtol=1e-8, atol=1e-9 * np.abs(bound).max()
            )


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=list(MOTIONS))
def test_the_bound_without_the_gram_gain_is_the_same_bound(motion: LinearMotion) -> None:
    run = Run(motion)
    both, alone = run.information(), Information(run.dynamics, ENVIRONMENTS, gram=False)
    alone.start(np.arange(ENVIRONMENTS), run.prior)
    for step in range(STEPS):
        for information in (both, alone):
            information.advance()
            information.absorb(run.jacobians[step], run.suite)
    np.testing.assert_array_equal(alone.bound, both.bound)
    assert alone.covariance.shape[2] == 1
    assert not alone.gram_gain.any()
    assert both.gram_gain.any()


@pytest.mark.parametrize("missing", [0.0, 0.4])
@pytest.mark.parametrize("motion", MOTIONS.values(), ids=list(MOTIONS))
def test_gram_gain_is_the_growth_of_the_log_determinant(
    motion: LinearMotion, nuisances: tuple[Nuisance, ...], missing: float
) -> None:
    """``ln det(G_k + P₀⁻¹) − ln det(G_{k−1} + P₀⁻¹)``, G summed up through powers of F: no process noise in it."""
    run = Run(motion, nuisances, missing)
    information, gramians = run.information(), [np.linalg.inv(prior) for *_, prior, _ in run.columns()]
    for step in range(STEPS):
        information.advance()
        information.absorb(run.jacobians[step], run.suite, run.detected[step] if missing else None)
        for column, (transition, _, r, _, jacobians) in enumerate(run.columns()):
            seen = jacobians[step] @ np.linalg.matrix_power(transition, step + 1)
            grown = gramians[column] + seen.T @ np.linalg.inv(r) @ seen
            gain = np.linalg.slogdet(grown)[1] - np.linalg.slogdet(gramians[column])[1]
            assert information.gram_gain[column] == pytest.approx(gain, rel=1e-6, abs=1e-8)
            gramians[column] = grown


@pytest.mark.parametrize("motion", MOTIONS.values(), ids=list(MOTIONS))
def test_undetected_measurements_tell_nothing(motion: LinearMotion) -> None:
    run = Run(motion, missing=0.5)
    information = run.information()
    information.advance()
    before = information.covariance.copy()
    information.absorb(run.jacobians[0], run.suite, np.zeros((2, ENVIRONMENTS), bool))
    np.testing.assert_array_equal(information.covariance, before)
    np.testing.assert_allclose(information.gram_gain, 0.0, atol=1e-12)


def test_a_noise_free_bound_needs_one_copy_alone() -> None:
    assert {name: Run(motion).information().covariance.shape[2] for name, motion in MOTIONS.items()} == {
        name: 1 if name in WITHOUT_NOISE else 2 for name in MOTIONS
    }


def test_start_touches_only_its_columns() -> None:
    run = Run(MOTIONS["CV"])
    information = run.information()
    information.absorb(run.jacobians[0], run.suite)
    before = information.covariance.copy()
    information.start(np.array([1]), run.prior[..., [1]])
    np.testing.assert_array_equal(information.covariance[..., [0, 2]], before[..., [0, 2]])
    np.testing.assert_array_equal(information.bound[..., 1], run.prior[..., 1])
    assert information.gram_gain[1] == 0.0
    assert (information.gram_gain[[0, 2]] > 0.0).all()


def test_sigma_along() -> None:
    covariance = np.array([[4.0, 1.0], [1.0, 9.0]])[..., None] * np.ones(3)
    axes = np.array([[1.0, 0.0, math.sqrt(0.5)], [0.0, 1.0, math.sqrt(0.5)]])
    np.testing.assert_allclose(sigma_along(covariance, axes), [2.0, 3.0, math.sqrt(7.5)])
    assert np.isfinite(np.log(sigma_along(-covariance, axes))).all()


def test_bits_do_not_depend_on_the_batch(assert_batch_free: Callable[..., None]) -> None:
    rng, size, layout = np.random.default_rng(1), 300, StateLayout(2)
    root = rng.normal(size=(4, 4, size))
    prior = np.einsum("ikN,jkN->ijN", root, root) + np.eye(4)[..., None]
    jacobian, suite = rng.normal(size=(2, 4, size)), SensorSuite((Noise(np.diag([1.0, 2.0])[..., None]),))

    def cycle(prior: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
        columns = prior.shape[-1]
        information = Information(Dynamics(MOTIONS["CV"], layout, PERIOD), columns)
        information.start(np.arange(columns), prior)
        information.advance()
        information.absorb(jacobian, suite)
        return np.concatenate([information.covariance.reshape(-1, columns), information.gram_gain[None]])

    assert_batch_free(cycle, prior, jacobian)


def moderate_legs(k: int) -> float:
    return 140.0 - 30.0 * min(max(k - 12, 0), 4)


def severe_legs(k: int) -> float:
    return -80.0 if k < 15 else 146.0


@pytest.mark.parametrize(
    ("name", "legs", "published"),
    [
        # Kilometres by minute, and how closely the publication's rounding lets us agree.
        (
            "OwnShipModerate",
            moderate_legs,
            {15: (1.34, 0.03), 20: (0.131, 0.03), 25: (0.055, 0.03), 32: (0.089, 0.02)},
        ),
        ("OwnShipSevere", severe_legs, {30: (0.109, 0.02)}),
    ],
)
def test_published_bounds_of_the_own_ship_cases(
    name: str,
    legs: Callable[[int], float],
    published: dict[int, tuple[float, float]],
    begin: Callable[..., Simulation],
) -> None:
    """Root of the trace of the position bound, with the published legs, along the noise-free truth."""
    simulation = begin(SCENARIOS[name].override({"target.motion.acceleration_density": 0.0}))
    (platform,) = simulation.realised.platforms
    for minute in range(1, max(published) + 1):
        belief = simulation.belief
        heading = np.radians([legs(minute - 1)])
        own_heading = belief.poses[0].heading
        action = platform.action_towards(heading, own_heading, belief.bearing, belief.interval)
        simulation.step(action[None])
        if minute in published:
            kilometres, tolerance = published[minute]
            found = math.sqrt(np.trace(simulation.information.bound[:2, :2, 0])) / 1e3
            assert found == pytest.approx(kilometres, rel=tolerance), f"minute {minute}"


@pytest.mark.parametrize("name", ["OwnShipModerate", "OwnShipSevere"])
def test_bound_begins_with_the_prior_at_the_truth(name: str, begin: Callable[..., Simulation]) -> None:
    """Polar standard deviations at the true bearing, range and speed, in a scenario whose prior is drawn elsewhere."""
    scenario = SCENARIOS[name]
    simulation = begin(scenario)
    east, north, speed_east, speed_north = simulation.truth[:4, 0]
    bearing, distance, speed = math.atan2(east, north), math.hypot(east, north), math.hypot(speed_east, speed_north)
    axes = np.array([[math.sin(bearing), math.cos(bearing)], [math.cos(bearing), -math.sin(bearing)]])
    prior, sigma = scenario.prior, scenario.sensors[0].sigma
    position = axes.T @ np.diag([prior.range_sigma, distance * sigma]) ** 2 @ axes
    velocity = axes.T @ np.diag([prior.speed_sigma, speed * prior.course_sigma]) ** 2 @ axes
    expected = block_diag(position, velocity)
    np.testing.assert_allclose(simulation.information.bound[..., 0], expected, rtol=1e-9, atol=1e-9)


def test_bound_does_not_depend_on_the_tracker_or_its_luck(begin: Callable[..., Simulation]) -> None:
    """The same flight with another tracker, and with other measurement noise, has the same bound."""
    scenario = SCENARIOS["BearingDopplerUnknownCarrier"].override(
        {
            "platforms.0.control": "turn_rate",
            "target": {
                "start": {"type": "PolarStart", "range": 30e3, "speed": 100.0},
                "motion": {"type": "ConstantVelocity"},
            },
            "platforms.0.heading": 1.0,
            "platforms.0.speed": 200.0,
            "sensors.1.carrier_sigma": 1e-9,
        }
    )
    runs = [begin(scenario, 1, 0), begin(scenario.override({"tracker.alpha": 0.5}), 1, 0), begin(scenario, 1, 9)]
    for run in runs:
        for _ in range(10):
            run.step(np.full((1, 1), 0.5))
    for other in runs[1:]:
        assert (other.track.mean != runs[0].track.mean).any()
        np.testing.assert_allclose(other.information.covariance, runs[0].information.covariance, rtol=1e-9)
