"""What the tests of the environment share: the hypothesis profile and three helpers."""

from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import settings

from passloc_env.errors import ScenarioError
from passloc_env.scenario import Scenario
from passloc_env.simulation import Simulation

# The same examples on every run and machine, and no clock: a slow machine is not a bug.
settings.register_profile("passloc", deadline=None, derandomize=True, max_examples=100)
settings.load_profile("passloc")


@pytest.fixture(scope="session")
def begin() -> Callable[..., Simulation]:
    """Begin episodes of a scenario in ``environments`` environments, seeded ``first_seed``, ``first_seed + 1``, …"""

    def begin(scenario: Scenario, environments: int = 1, first_seed: int = 0) -> Simulation:
        simulation = Simulation(scenario, environments)
        generators = [np.random.default_rng(first_seed + column) for column in range(environments)]
        simulation.reset(np.arange(environments), generators)
        return simulation

    return begin


@pytest.fixture(scope="session")
def assert_batch_free() -> Callable[..., None]:
    """Assert that a function of arrays ``(…, N)`` gives any slice of the batch the bits it gives the whole."""

    def check(function: Callable[..., np.ndarray], *arrays: np.ndarray) -> None:
        size = max(array.shape[-1] for array in arrays)
        whole = function(*(array.copy() for array in arrays))
        for width in (1, 3, 17):
            part = slice(size // 2, size // 2 + width)
            slices = [array[..., part].copy() if array.shape[-1] > 1 else array.copy() for array in arrays]
            found = function(*slices)
            assert found.shape == whole[..., part].shape
            assert found.tobytes() == whole[..., part].tobytes()

    return check


@pytest.fixture(scope="session")
def refusal() -> Callable[..., ScenarioError]:
    """The one ScenarioError that a call raises: one line that names field, value and what is allowed."""

    def refusal(call: Callable[..., object], *arguments: object) -> ScenarioError:
        with pytest.raises(ScenarioError) as caught:
            call(*arguments)
        error = caught.value
        assert str(error) == f"{error.field} = {error.value!r} is not possible: {error.allowed}"
        assert "\n" not in str(error)
        assert error.field
        assert error.allowed
        assert error.__cause__ is None
        assert error.__suppress_context__ or error.__context__ is None
        return error

    return refusal
