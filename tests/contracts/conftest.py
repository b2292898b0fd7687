"""What the contract tests share: short eventful episodes, and equality to the last bit."""

import math
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest

from passloc_env import SCENARIOS, LocalisationVectorEnv
from passloc_env.target import CartesianStart, GeodeticStart, PolarStart

Overrides = dict[str, Any]
SHORT_DECISIONS = 4


def _uniform(low: float, high: float) -> Overrides:
    return {"type": "Uniform", "low": low, "high": high}


@pytest.fixture(scope="session")
def short() -> Callable[[str], Overrides]:
    """By scenario name: overrides for episodes of four decisions that start close to the keep-out.

    Some are violated, some last until their time is over.
    """

    def overrides(name: str) -> Overrides:
        scenario = SCENARIOS[name]
        episode, start = scenario.episode, scenario.target.start
        changes: Overrides = {"episode.steps": SHORT_DECISIONS * episode.decision_every, "episode.early_end": True}
        if isinstance(start, PolarStart):
            fastest = start.speed if isinstance(start.speed, float) else start.speed.support[1]
            closest = max(episode.min_range, 1e3, 12.0 * fastest * episode.interval)
            changes |= {
                "episode.min_range": closest,
                "target.start.range": _uniform(1.02 * closest, 1.4 * closest),
            }
        elif name == "CrossFix":
            # Vehicles start on the edges of a square of 1 km, the emitter 100 m or more from them.
            changes["episode.min_range"] = 250.0
        elif isinstance(start, CartesianStart):
            # Straight in: whoever flies at it meets the limit, whoever flies away does not.
            away, speed = math.hypot(*start.position), math.hypot(*start.velocity)
            changes["target.start.velocity"] = [-speed * axis / away for axis in start.position]
            closing = speed + 0.25 * scenario.platforms[0].speed
            changes["episode.min_range"] = away - SHORT_DECISIONS * closing * episode.interval
        elif isinstance(start, GeodeticStart):
            # Ahead of the satellites and to starboard; these come nearer by 7 km a second.
            changes["target.start.latitude"] = _uniform(math.radians(28.0), math.radians(31.0))
            changes["episode.min_range"] = 770e3
        else:
            raise AssertionError(f"say how to begin {name} close to the emitter")
        return changes

    return overrides


@pytest.fixture(scope="session")
def assert_same() -> Callable[..., None]:
    """Equality of nested results: keys, types, dtypes, shapes and every bit."""

    def compare(a: Any, b: Any, where: str = "") -> None:
        if isinstance(a, dict):
            assert isinstance(b, dict), where
            assert a.keys() == b.keys(), where
            for key in a:
                compare(a[key], b[key], f"{where}/{key}")
        elif isinstance(a, (tuple, list)):
            assert type(a) is type(b), where
            assert len(a) == len(b), where
            for index, (x, y) in enumerate(zip(a, b, strict=True)):
                compare(x, y, f"{where}/{index}")
        elif isinstance(a, np.ndarray):
            assert isinstance(b, np.ndarray), where
            assert (a.dtype, a.shape) == (b.dtype, b.shape), where
            if a.dtype == object:
                compare(a.tolist(), b.tolist(), where)
            else:
                assert a.tobytes() == b.tobytes(), f"{where}: {a} is not {b}"
        else:
            assert type(a) is type(b), f"{where}: {type(a)} is not {type(b)}"
            assert a == b or (a != a and b != b), f"{where}: {a} is not {b}"

    return compare


@pytest.fixture(scope="session")
def actions() -> Callable[..., Iterator[np.ndarray]]:
    """Endless actions ``(environments, 1)``: every other one flies at the emitter, the rest is random."""

    def stream(environments: int, size: int = 1, seed: int = 0) -> Iterator[np.ndarray]:
        rng = np.random.default_rng(seed)
        while True:
            action = rng.uniform(-1, 1, (environments, size)).astype(np.float32)
            action[::2] *= 0.05
            yield action

    return stream


@pytest.fixture(scope="session")
def rows() -> Callable[..., Any]:
    """Some environments of whatever a vector environment returned; of dictionaries only the keys of ``like``."""

    def pick(value: Any, part: slice, like: Any) -> Any:
        if isinstance(like, dict):
            return {key: pick(value[key], part, like[key]) for key in like}
        if isinstance(like, tuple):
            return tuple(pick(item, part, one) for item, one in zip(value, like, strict=True))
        return value[part]

    return pick


@pytest.fixture
def vector_env(short: Callable[[str], Overrides]) -> Callable[..., LocalisationVectorEnv]:
    """Builds vector environments of short episodes with everything in their infos."""

    def build(
        num_envs: int = 4, name: str = "BearingsOnly", mode: str = "NextStep", **changes: Any
    ) -> LocalisationVectorEnv:
        overrides = {**short(name), **changes}
        return LocalisationVectorEnv(num_envs, name, overrides=overrides, autoreset_mode=mode, diagnostics=True)

    return build


@pytest.fixture(params=["CrossingKalman", "ExtendedKalman", "FilterPyTracker", "SquareRootKalman", "UnscentedKalman"])
def tracker(request: pytest.FixtureRequest) -> Overrides:
    """Each tracker that fits any sensors of a planar scenario, as plain data."""
    motion = {"type": "ConstantVelocity", "acceleration_noise": 0.02}
    return {"type": request.param, "motion": motion}
