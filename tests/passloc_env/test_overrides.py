"""Any field of a scenario can be changed by its dotted name, and survives being written and read."""

from collections.abc import Callable
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st

from passloc_env.distributions import Choice, LogUniform, Uniform
from passloc_env.errors import ScenarioError
from passloc_env.motion import ConstantAcceleration, ConstantVelocity, CoordinatedTurn, Manoeuvre, UnknownTurn
from passloc_env.platforms import TurnLimitedPlatform
from passloc_env.rewards import ControlEffort, GramGain, RangeBound, TrackingError
from passloc_env.scenario import Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensors import Bearing
from passloc_env.tracking import UnscentedKalman

Refusal = Callable[..., ScenarioError]

POSITIVE = st.floats(1e-9, 1e9)
QUANTITY = st.one_of(
    POSITIVE,
    st.builds(lambda a, b: Uniform(min(a, b), max(a, b)), POSITIVE, POSITIVE),
    st.builds(lambda a, b: LogUniform(min(a, b), max(a, b)), POSITIVE, POSITIVE),
    st.builds(lambda values: Choice(tuple(values)), st.lists(POSITIVE, min_size=1, max_size=3)),
)
LINEAR_MOTION = st.one_of(
    st.builds(ConstantVelocity, acceleration_noise=QUANTITY, known_acceleration=st.tuples(QUANTITY, POSITIVE)),
    st.builds(ConstantAcceleration, acceleration_noise=QUANTITY),
    st.builds(CoordinatedTurn, turn_rate=QUANTITY),
)
MODEL_MOTION = st.one_of(LINEAR_MOTION, st.builds(UnknownTurn, turn_rate_sigma=QUANTITY))
REWARD = st.permutations([RangeBound(), GramGain(weight=2.0), TrackingError(), ControlEffort(reference=0.1)])
CHANGES = st.fixed_dictionaries(
    {},
    optional={
        "name": st.text(
            st.characters(exclude_categories=["C", "Z"], exclude_characters="./\\"), min_size=1, max_size=100
        ),
        "target.motion": st.one_of(MODEL_MOTION, st.builds(Manoeuvre, start=QUANTITY, duration=POSITIVE)),
        "platforms.0.speed": QUANTITY,
        "platforms.TurnLimitedPlatform.max_turn_rate": st.one_of(QUANTITY, st.just(float("inf"))),
        "sensors.Bearing.sigma": QUANTITY,
        "sensors.0.lever_arm": st.one_of(st.just(()), st.tuples(QUANTITY, POSITIVE)),
        "tracker.motion": MODEL_MOTION,
        "tracker.beta": st.floats(-10, 10),
        "bound.motion": LINEAR_MOTION,
        "reward": st.builds(lambda terms, count: terms[:count], REWARD, st.integers(0, 4)),
        "observation.speed_scale": POSITIVE,
        "episode.min_range": st.floats(0.0, 100.0),
        "episode.early_end": st.booleans(),
    },
)


def has_the_changed_fields(scenario: Scenario) -> bool:
    """One vehicle, one bearing, and a tracker that takes any motion: what the changes above are written for."""
    kinds = [type(part) for part in (*scenario.platforms, *scenario.sensors, scenario.tracker)]
    return kinds[0] is TurnLimitedPlatform and [kinds.count(Bearing), kinds.count(UnscentedKalman)] == [1, 1]


FITTING = [scenario for scenario in SCENARIOS.values() if has_the_changed_fields(scenario)]


def test_most_scenarios_are_overridden_here() -> None:
    assert len(FITTING) > len(SCENARIOS) / 2


@given(st.sampled_from(FITTING), CHANGES)
def test_overridden_scenarios_survive_plain_data(scenario: Scenario, changes: dict[str, Any]) -> None:
    changed = scenario.override(changes)
    assert Scenario.from_json(changed.to_json()) == changed
    assert Scenario.from_yaml(changed.to_yaml()) == changed


@given(st.sampled_from(FITTING), CHANGES)
def test_only_the_named_fields_change(scenario: Scenario, changes: dict[str, Any]) -> None:
    before, changed = scenario.to_dict(), scenario.override(changes)
    assert scenario.to_dict() == before
    back = {name: _get(scenario, name) for name in changes}
    assert changed.override(back) == scenario


def _get(component: Any, name: str) -> Any:
    for key in name.split("."):
        if not isinstance(component, tuple):
            component = getattr(component, key)
        elif key.isdigit():
            component = component[int(key)]
        else:
            (component,) = (item for item in component if type(item).__name__ == key)
    return component


@pytest.mark.parametrize(
    ("changes", "name", "value"),
    [
        ({"sensors.0.sigma": "3e-3"}, "sensors.0.sigma", 3e-3),
        ({"sensors.Bearing.sigma": 0.01}, "sensors.0.sigma", 0.01),
        ({"sensors.0": {"type": "Bearing", "sigma": 0.01}}, "sensors.0", Bearing(sigma=0.01)),
        ({"sensors": [{"type": "Bearing", "sigma": 0.01}]}, "sensors", (Bearing(sigma=0.01),)),
        ({"platforms.0.position.1": 5}, "platforms.0.position", (0.0, 5.0)),
        ({"target.motion.acceleration_noise": 1}, "target.motion", ConstantVelocity(acceleration_noise=1.0)),
    ],
)
def test_ways_to_name_a_field(changes: dict[str, Any], name: str, value: Any) -> None:
    assert _get(Scenario().override(changes), name) == value


def test_no_changes_change_nothing() -> None:
    assert Scenario().override({}) == Scenario()


def test_changes_are_checked_together() -> None:
    # Either alone would be impossible: 7 does not divide 240, nor 4 divide 7.
    changed = Scenario().override({"episode.steps": 7, "episode.decision_every": 7})
    assert (changed.episode.steps, changed.episode.decision_every) == (7, 7)


@pytest.mark.parametrize(
    ("changes", "field", "value", "words"),
    [
        pytest.param({"epsiode.steps": 3}, "epsiode", None, "did you mean 'episode'", id="unknown component"),
        pytest.param({"episode.step": 3}, "episode.step", 3, "did you mean 'steps'", id="unknown field"),
        pytest.param({"sensors.Bearing.sgima": 3}, "sensors.Bearing.sgima", 3, "did you mean 'sigma'", id="in a list"),
        pytest.param({"sensors.5.sigma": 3}, "sensors.5", None, "known: 0, Bearing", id="index out of range"),
        pytest.param({"sensors.-1.sigma": 3}, "sensors.-1", None, "known: 0, Bearing", id="negative index"),
        pytest.param({"sensors.².sigma": 3}, "sensors.²", None, "known: 0, Bearing", id="digit that is no number"),
        pytest.param({"sensors.Bearng.sigma": 3}, "sensors.Bearng", None, "did you mean 'Bearing'", id="item name"),
        pytest.param({"episode.steps.x": 3}, "episode.steps", None, "no such field inside 240", id="inside a number"),
        pytest.param({"sensors.0.sigma": -1.0}, "sensors.0.sigma", -1.0, "above 0 rad", id="impossible value"),
        pytest.param({"episode.period": 0}, "episode.period", 0, "must be a plain number, above 0 s", id="zero period"),
        pytest.param(
            {"target.motion": {"type": "ConstantVelocity", "acceleration_nois": 1}},
            "target.motion.acceleration_nois",
            1,
            "did you mean 'acceleration_noise'",
            id="unknown field in data",
        ),
        pytest.param(
            {"episode": {"steps": 40}, "episode.period": 2.0},
            "episode.period",
            2.0,
            "replaced as a whole",
            id="whole first",
        ),
        pytest.param(
            {"episode.period": 2.0, "episode": {"steps": 40}},
            "episode.period",
            2.0,
            "replaced as a whole",
            id="part first",
        ),
    ],
)
def test_bad_changes_are_refused_by_name(
    changes: dict[str, Any], field: str, value: Any, words: str, refusal: Refusal
) -> None:
    error = refusal(Scenario().override, changes)
    assert error.field == field
    assert value is None or error.value == value
    assert words in error.allowed


def test_class_names_must_be_unique(refusal: Refusal) -> None:
    twins = Scenario().override({"sensors": [Bearing(sigma=1.0), Bearing(sigma=2.0)]})
    allowed = refusal(twins.override, {"sensors.Bearing.sigma": 3.0}).allowed
    assert allowed == "there are several Bearing; name one by number: 0, 1"
    assert twins.override({"sensors.1.sigma": 3.0}).sensors == (Bearing(sigma=1.0), Bearing(sigma=3.0))
