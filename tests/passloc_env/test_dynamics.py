"""Process noise against FilterPy and van Loan, and the step that trackers and truth take."""

from collections.abc import Callable

import numpy as np
import pytest
from filterpy.common import Q_continuous_white_noise, Q_discrete_white_noise
from scipy.linalg import expm

from passloc_env.distributions import Uniform
from passloc_env.dynamics import Dynamics
from passloc_env.motion import (
    ConstantAcceleration,
    ConstantVelocity,
    CoordinatedTurn,
    Manoeuvre,
    Motion,
    UnknownTurn,
)
from passloc_env.nuisance import Nuisance
from passloc_env.randomisation import Randomisation

PERIOD = 2.5
SIGMA = 0.3


def dynamics(motion: Motion, dimension: int = 2, nuisances: tuple[Nuisance, ...] = (), dense: bool = False) -> Dynamics:
    states = motion.nuisances + nuisances
    layout = motion.layout(dimension).with_nuisance(tuple(nuisance.name for nuisance in nuisances))
    return Dynamics(motion, layout, PERIOD, states, dense=dense)


def van_loan(dimension: int, density: float) -> np.ndarray:
    """Q of continuous white acceleration by van Loan's matrix exponential."""
    n, eye = 2 * dimension, np.eye(dimension)
    a, drive = np.zeros((n, n)), np.zeros((n, n))
    a[:dimension, dimension:], drive[dimension:, dimension:] = eye, density * eye
    block = expm(np.block([[-a, drive], [np.zeros((n, n)), a.T]]) * PERIOD)
    return block[n:, n:].T @ block[:n, n:]


def discrete(derivatives: int, dimension: int) -> np.ndarray:
    return Q_discrete_white_noise(derivatives, PERIOD, SIGMA**2, dimension, order_by_dim=False)


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize(
    ("motion", "reference"),
    [
        (ConstantVelocity(acceleration_noise=SIGMA), lambda d: discrete(2, d)),
        (CoordinatedTurn(turn_rate=0.1, acceleration_noise=SIGMA), lambda d: discrete(2, d)),
        (ConstantAcceleration(acceleration_noise=SIGMA), lambda d: discrete(3, d)),
        (
            ConstantVelocity(acceleration_density=SIGMA),
            lambda d: Q_continuous_white_noise(2, PERIOD, SIGMA, d, order_by_dim=False),
        ),
        (ConstantVelocity(acceleration_density=SIGMA), lambda d: van_loan(d, SIGMA)),
        (
            ConstantVelocity(acceleration_noise=SIGMA, acceleration_density=2.0),
            lambda d: discrete(2, d) + van_loan(d, 2.0),
        ),
    ],
    ids=["CV", "CT", "CA", "continuous, FilterPy", "continuous, van Loan", "both"],
)
def test_process_noise(motion: Motion, reference: Callable[[int], np.ndarray], dimension: int) -> None:
    found = dynamics(motion, dimension).process_noise[..., 0]
    np.testing.assert_allclose(found, reference(dimension), rtol=1e-12, atol=1e-12)
    np.testing.assert_array_equal(found, found.T)


NOISY = [
    ConstantVelocity(acceleration_noise=SIGMA, acceleration_density=2.0),
    ConstantAcceleration(acceleration_noise=SIGMA),
    UnknownTurn(acceleration_noise=SIGMA, turn_rate_noise=0.01),
]
WALKS = (Nuisance("carrier_offset", 1e3, 5.0), Nuisance("bias", 1.0))


@pytest.mark.parametrize("motion", NOISY, ids=["CV", "CA", "unknown turn"])
def test_disturb_has_the_covariance_of_process_noise(motion: Motion) -> None:
    """Each unit normal shows one column of Γ, and Γ Γᵀ is Q: no statistics needed."""
    step = dynamics(motion, nuisances=WALKS)
    columns = np.zeros((step.layout.size, step.noise_size))
    step.disturb(columns, np.eye(step.noise_size))
    np.testing.assert_allclose(columns @ columns.T, step.process_noise[..., 0], rtol=1e-14, atol=1e-14)


def test_empirical_process_noise() -> None:
    step, draws = dynamics(NOISY[0], nuisances=WALKS), 50_000
    samples = np.zeros((step.layout.size, draws))
    step.disturb(samples, np.random.default_rng(3).standard_normal((step.noise_size, draws)))
    expected = step.process_noise[..., 0]
    # Five standard deviations of a sample covariance: by chance once in 50 000 seeds for all entries together.
    spread = np.sqrt((np.outer(np.diag(expected), np.diag(expected)) + expected**2) / draws)
    assert (np.abs(np.cov(samples) - expected) <= 5.0 * spread).all()


def test_nuisances_walk_alone() -> None:
    step = dynamics(ConstantVelocity(acceleration_noise=SIGMA), nuisances=WALKS)
    carrier, bias = (step.layout.nuisance_row(nuisance.name) for nuisance in WALKS)
    expected = np.zeros(step.layout.size)
    expected[carrier] = 25.0
    np.testing.assert_array_equal(step.process_noise[carrier, :, 0], expected)
    np.testing.assert_array_equal(step.process_noise[bias], 0.0)
    assert step.noise_size == 3


def test_walks_may_differ_between_environments() -> None:
    walk = np.array([1.0, 2.0, 0.0])
    step = dynamics(ConstantVelocity(), nuisances=(Nuisance("bias", 1.0, walk),), dense=True)
    np.testing.assert_array_equal(step.process_noise[-1, -1], walk**2)


@pytest.mark.parametrize("motion", [ConstantVelocity(), Manoeuvre(start=0.0, duration=1.0)], ids=["CV", "manoeuvre"])
def test_no_noise_takes_no_normals(motion: Motion) -> None:
    step, state = dynamics(motion), np.ones((4, 3))
    step.disturb(state, np.zeros((0, 3)))
    assert step.noise_size == 0
    np.testing.assert_array_equal(state, 1.0)
    np.testing.assert_array_equal(step.process_noise, 0.0)


@pytest.mark.parametrize("dense", [False, True])
@pytest.mark.parametrize("motion", [NOISY[0], NOISY[1], CoordinatedTurn(turn_rate=0.1)], ids=["CV", "CA", "CT"])
def test_linear_step_is_the_textbook_step(motion: Motion, dense: bool) -> None:
    step, rng = dynamics(motion, nuisances=WALKS, dense=dense), np.random.default_rng(4)
    n = step.layout.size
    transition, noise = step.transition.matrix[..., 0], step.process_noise[..., 0]
    states, root = rng.normal(size=(n, 5, 3)), rng.normal(size=(n, n, 3))
    covariance = np.einsum("ikN,jkN->ijN", root, root)
    expected = np.einsum("ij,jkN->ikN", transition, states)
    np.testing.assert_allclose(step.mean(states, np.zeros(3)), expected, rtol=1e-12, atol=1e-12)
    spread = np.einsum("ia,abN,jb->ijN", transition, covariance, transition) + noise[..., None]
    step.spread(covariance)
    np.testing.assert_allclose(covariance, spread, rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "motion",
    [*NOISY, ConstantVelocity(known_acceleration=(2.0, -1.0)), Manoeuvre(start=0.0, duration=1.0, turn_rate=0.1)],
    ids=["CV", "CA", "unknown turn", "known input", "manoeuvre"],
)
def test_advance_is_the_mean_in_place(motion: Motion) -> None:
    step = dynamics(motion, nuisances=WALKS)
    state, time = np.random.default_rng(6).normal(size=(step.layout.size, 7)), np.zeros(7)
    expected = step.mean(state, time)
    step.advance(state, time)
    np.testing.assert_allclose(state, expected, rtol=1e-15)


def test_known_input_reaches_every_sigma_point() -> None:
    step = dynamics(ConstantVelocity(known_acceleration=(2.0, -1.0)))
    moved = step.mean(np.zeros((4, 9, 3)), np.zeros(3))
    expected = np.array([PERIOD**2, -(PERIOD**2) / 2, 2 * PERIOD, -PERIOD])
    np.testing.assert_allclose(moved, np.broadcast_to(expected[:, None, None], moved.shape))


def test_nonlinear_motion_has_no_transition() -> None:
    step = dynamics(UnknownTurn())
    assert not step.linear
    with pytest.raises(TypeError, match="UnknownTurn is not linear"):
        step.spread(np.zeros((5, 5, 1)))


def drawn(motion: Motion) -> Motion:
    """The motion with the numbers of three environments in place of its distributions."""
    randomisation = Randomisation(motion, 3)
    randomisation.sample(np.arange(3), np.random.default_rng(7).random((randomisation.size, 3)))
    return randomisation.realised


REPEATABLE = {
    "CV": ConstantVelocity(acceleration_noise=0.3),
    "CV, continuous": ConstantVelocity(acceleration_density=0.5),
    "CV, per environment": drawn(ConstantVelocity(acceleration_noise=Uniform(low=0.1, high=0.4))),
    "CA": ConstantAcceleration(acceleration_noise=0.1),
    "turns, per environment": drawn(CoordinatedTurn(turn_rate=Uniform(low=-0.1, high=0.3), acceleration_noise=0.2)),
    "known input": ConstantVelocity(known_acceleration=(2.0, -1.0)),
}


@pytest.mark.parametrize("name", REPEATABLE)
@pytest.mark.parametrize("steps", [1, 2, 7])
def test_several_steps_as_one(name: str, steps: int) -> None:
    """Mean and covariance as after that many steps, one at a time."""
    step = dynamics(REPEATABLE[name], nuisances=(Nuisance("bias", 1.0, 0.2),), dense="per" in name)
    rng = np.random.default_rng(8)
    n = step.layout.size
    state, root = rng.normal(size=(n, 3)), rng.normal(size=(n, n, 3))
    covariance = np.einsum("ikN,jkN->ijN", root, root)
    leap, time = step.repeated(steps), np.zeros(3)
    at_once, spread = leap.mean(state, time), covariance.copy()
    leap.spread(spread)
    for _ in range(steps):
        step.advance(state, time)
        step.spread(covariance)
    np.testing.assert_allclose(at_once, state, rtol=1e-12, atol=1e-12)
    np.testing.assert_allclose(spread, covariance, rtol=1e-11, atol=1e-11)
    assert leap.period == steps * PERIOD
    assert step.period == PERIOD


def test_noise_of_several_steps_is_drawn_from_all_of_them() -> None:
    """The gain of the drive and the covariance agree."""
    leap = dynamics(ConstantVelocity(acceleration_noise=0.3)).repeated(3)
    gain = np.stack([_column(leap, unit) for unit in np.eye(leap.noise_size)], axis=1)
    np.testing.assert_allclose(gain @ gain.T, leap.process_noise[..., 0], rtol=1e-12)


def _column(step: Dynamics, normals: np.ndarray) -> np.ndarray:
    state = np.zeros((step.layout.size, 1))
    step.disturb(state, normals[:, None])
    return state[:, 0]


def test_steps_of_a_nonlinear_motion_cannot_be_taken_as_one() -> None:
    with pytest.raises(TypeError, match="UnknownTurn is not linear"):
        dynamics(UnknownTurn()).repeated(2)
