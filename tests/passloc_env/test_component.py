"""Components check their fields, name what is wrong, and survive JSON and YAML."""

import dataclasses
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from passloc_env.component import Component, from_dict, specs, to_dict
from passloc_env.distributions import Distribution, LogUniform, Uniform
from passloc_env.errors import ScenarioError
from passloc_env.platforms import FixedStation, TurnLimitedPlatform
from passloc_env.scenario import Episode, Scenario
from passloc_env.scenarios import SCENARIOS
from passloc_env.sensors import Bearing, Sensor

Refusal = Callable[..., ScenarioError]
CONCRETE = {
    n: k
    for n, k in Component.registry.items()
    if dataclasses.is_dataclass(k) and k.__module__.startswith("passloc_env.")
}


@pytest.mark.parametrize("scenario", SCENARIOS.values(), ids=list(SCENARIOS))
def test_named_scenarios_survive_plain_data(scenario: Scenario) -> None:
    assert Scenario.from_dict(scenario.to_dict()) == scenario
    assert Scenario.from_json(scenario.to_json()) == scenario
    assert Scenario.from_yaml(scenario.to_yaml()) == scenario
    assert json.loads(json.dumps(scenario.to_dict(), allow_nan=False)) == scenario.to_dict()


@pytest.mark.parametrize("suffix", [".json", ".yaml", ".yml"])
def test_scenarios_are_read_from_files(tmp_path: Any, suffix: str) -> None:
    scenario = SCENARIOS["OwnShipSevere"]
    path = tmp_path / f"scenario{suffix}"
    path.write_text(scenario.to_json() if suffix == ".json" else scenario.to_yaml(), encoding="utf-8")
    assert Scenario.from_file(path) == scenario


def test_infinity_survives_strict_json() -> None:
    platform = TurnLimitedPlatform(speed=1.0, max_turn_rate=math.inf)
    assert to_dict(platform)["max_turn_rate"] == "inf"
    assert from_dict(to_dict(platform)) == platform


def test_fields_left_out_keep_their_defaults() -> None:
    assert Scenario.from_dict({}) == Scenario()
    assert Scenario.from_dict({"episode": {"steps": 8}}).episode == Episode(steps=8)


@pytest.mark.parametrize("kind", CONCRETE.values(), ids=list(CONCRETE))
def test_every_field_is_documented(kind: type[Component]) -> None:
    assert all(spec.doc for spec in specs(kind).values())
    assert kind.__doc__


def test_components_are_frozen() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        Bearing(sigma=1.0).sigma = 2.0


@pytest.mark.parametrize("value", [0.003, "3e-3", "0.003", np.float64(0.003), np.float32(0.003)])
def test_numbers_of_any_dress_become_floats(value: Any) -> None:
    sigma = Bearing(sigma=value).sigma
    assert type(sigma) is float
    assert sigma == pytest.approx(0.003, rel=1e-7)  # float32 has seven digits


@pytest.mark.parametrize("value", [1, np.int64(1), "1"])
def test_whole_numbers_are_numbers(value: Any) -> None:
    assert type(Bearing(sigma=value).sigma) is float


def test_distributions_come_as_objects_or_data() -> None:
    data = {"type": "LogUniform", "low": "1e-3", "high": 1}
    assert Bearing(sigma=data).sigma == Bearing(sigma=LogUniform(1e-3, 1.0)).sigma == LogUniform(1e-3, 1.0)


def test_lists_become_tuples_of_numbers() -> None:
    assert FixedStation(position=[1, "2", Uniform(0.0, 1.0)]).position == (1.0, 2.0, Uniform(0.0, 1.0))
    assert FixedStation(position=np.array([1.0, 2.0])).position == (1.0, 2.0)


@pytest.mark.parametrize(
    "value",
    [
        *(-0.1, 0.0, math.nan, math.inf, -math.inf, True, np.True_, "much", "nan", None, [0.1], 1j),
        *(Uniform(0.0, 1.0), Uniform(-1.0, 1.0), Uniform(1.0, 2.0, either_sign=True)),
    ],
    ids=repr,
)
def test_impossible_sigmas(value: Any, refusal: Refusal) -> None:
    error = refusal(lambda: Bearing(sigma=value))
    assert (error.field, error.allowed) == ("sigma", "must be above 0 rad, or a distribution")
    assert error.value is value


@pytest.mark.parametrize(
    ("field", "value", "allowed"),
    [
        ("detection_probability", 1.1, "above 0 and at most 1, or a distribution"),
        ("detection_probability", Uniform(0.5, 1.5), "above 0 and at most 1, or a distribution"),
        ("platform", -1, "a whole number of at least 0"),
        ("platform", 1.0, "a whole number of at least 0"),
        ("platform", True, "a whole number of at least 0"),
        ("lever_arm", 3.0, "a list of numbers"),
        ("lever_arm", "12", "a list of numbers"),
        ("lever_arm.1", (0.0, "x"), "any finite number m, or a distribution"),
    ],
)
def test_impossible_fields(field: str, value: Any, allowed: str, refusal: Refusal) -> None:
    error = refusal(lambda: Bearing(**{"sigma": 1.0, field.split(".")[0]: value}))
    assert error.field == field
    assert error.allowed == f"must be {allowed}"


@pytest.mark.parametrize(
    ("data", "field", "value", "words"),
    [
        pytest.param({"sensor": 1}, "sensor", 1, "did you mean 'sensors'", id="unknown key"),
        pytest.param({"episode": {"step": 8}}, "episode.step", 8, "did you mean 'steps'", id="unknown nested key"),
        pytest.param(
            {"sensors": [{"type": "Bearing", "sgima": 0.1}]},
            "sensors.0.sgima",
            0.1,
            "did you mean 'sigma'",
            id="unknown key in a list",
        ),
        pytest.param({"nonsense": 1}, "nonsense", 1, "known: bound, episode", id="unlike any key"),
        pytest.param({1: 2}, "1", 2, "no such field", id="key that is no text"),
        pytest.param(
            {"sensors": [{"type": "Bearng", "sigma": 1.0}]},
            "sensors.0.type",
            "Bearng",
            "did you mean 'Bearing'",
            id="unknown type",
        ),
        pytest.param({"sensors": [{"sigma": 1.0}]}, "sensors.0.type", None, "no such component type", id="no type"),
        pytest.param({"sensors": [{"type": ["Bearing"]}]}, "sensors.0.type", ["Bearing"], "no such", id="odd type"),
        pytest.param({"sensors": [{"type": "Sensor"}]}, "sensors.0.type", "Sensor", "no such", id="abstract type"),
        pytest.param({"sensors": [{"type": "Bearing"}]}, "sensors.0.sigma", None, "Bearing needs it", id="missing"),
        pytest.param({"sensors": [{"type": "Bound"}]}, "sensors.0", "Bound", "must be a Sensor", id="wrong kind"),
        pytest.param({"sensors": [3]}, "sensors.0", 3, "must be a Sensor", id="no component"),
        pytest.param({"sensors": {}}, "sensors", {}, "must be a list of Sensor", id="no list"),
        pytest.param({"sensors": []}, "sensors", [], "needs at least 1 Sensor", id="empty list"),
        pytest.param({"tracker": "UKF"}, "tracker", "UKF", "must be a Tracker", id="text for a component"),
        pytest.param({"name": 3}, "name", 3, "must be text", id="number for text"),
        pytest.param({"episode": {"early_end": 1}}, "episode.early_end", 1, "must be true or false", id="1 for true"),
        pytest.param(
            {"platforms": [{"type": "TurnLimitedPlatform", "speed": 1, "max_turn_rate": 1, "control": "headng"}]},
            "platforms.0.control",
            "headng",
            "did you mean 'heading'",
            id="unknown option",
        ),
        pytest.param(
            {"sensors": [{"type": "Bearing", "sigma": {"type": "Uniform", "low": 1, "high": "x"}}]},
            "sensors.0.sigma.high",
            "x",
            "must be a finite number",
            id="inside a distribution",
        ),
        pytest.param({"type": "Bearing", "sigma": 1.0}, "type", "Bearing", "Scenario", id="no scenario at all"),
    ],
)
def test_bad_data_is_refused_by_name(data: Any, field: str, value: Any, words: str, refusal: Refusal) -> None:
    error = refusal(Scenario.from_dict, data)
    assert error.field == field
    assert error.value == value
    assert words in error.allowed


def test_only_types_that_would_fit_are_suggested(refusal: Refusal) -> None:
    """Thirty-odd components exist; a sensor is one of five."""
    allowed = refusal(Scenario.from_dict, {"sensors": [{"type": "Dopler"}]}).allowed
    assert "did you mean 'Doppler'?" in allowed
    known = allowed.split("known: ")[1].split(", ")
    assert {"Bearing", "Doppler", "PhaseDifference", "RadialAcceleration", "TimeDifference"} <= set(known)
    assert all(issubclass(Component.registry[name], Sensor) for name in known)


@pytest.mark.parametrize("suffix", [".json", ".yaml"])
@pytest.mark.parametrize("text", ["", "[1", "[1]"])
def test_a_file_that_is_no_scenario_is_named(tmp_path: Path, suffix: str, text: str, refusal: Refusal) -> None:
    """The file, not what little of it there is."""
    path = tmp_path / f"mine{suffix}"
    path.write_text(text, encoding="utf-8")
    error = refusal(Scenario.from_file, path)
    assert (error.field, error.value) == ("scenario", str(path))


@pytest.mark.parametrize(
    ("read", "text"),
    [
        (Scenario.from_yaml, "sensors: [1"),
        (Scenario.from_yaml, "? [a]\n: b"),
        (Scenario.from_yaml, "!!python/object/apply:os.getcwd []"),
        (Scenario.from_yaml, "- a\n- list"),
        (Scenario.from_yaml, ""),
        (Scenario.from_json, "{"),
        (Scenario.from_json, "[1]"),
    ],
)
def test_unreadable_text(read: Callable[[str], Scenario], text: str, refusal: Refusal) -> None:
    error = refusal(read, text)
    assert error.field == "scenario"
    assert "readable" in error.allowed or "mapping of fields" in error.allowed


def test_yaml_reads_exponents_without_a_point() -> None:
    # YAML 1.1 takes 3e-3 for text.
    scenario = Scenario.from_yaml("sensors: [{type: Bearing, sigma: 3e-3}]")
    assert scenario.sensors == (Bearing(sigma=3e-3),)


def test_distributions_themselves_are_components() -> None:
    assert isinstance(from_dict({"type": "Uniform", "low": 0, "high": 1}), Distribution)
