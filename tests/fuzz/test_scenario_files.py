"""Scenario files and override words of strangers: an equal scenario, or one line."""

import json
from pathlib import Path

import pytest
import yaml
from fuzzing import BYTES, PLAIN, changed_bytes, changed_data, fuzzed, read_or_refused
from hypothesis import given
from hypothesis import strategies as st

from passloc_env import SCENARIOS, Scenario
from passloc_env.component import specs
from passloc_env.scenarios import find
from training.arguments import parse_overrides

SENT = st.sampled_from(list(SCENARIOS.values()))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("scenarios")


def assert_read_or_refused(path: Path) -> None:
    scenario = read_or_refused(lambda: find(str(path)))
    if scenario is not None:
        assert Scenario.from_yaml(scenario.to_yaml()) == scenario
        assert Scenario.from_json(scenario.to_json()) == scenario


@fuzzed
@given(BYTES, st.sampled_from([".yaml", ".json"]))
def test_any_bytes(folder: Path, content: bytes, suffix: str) -> None:
    path = folder / f"any{suffix}"
    path.write_bytes(content)
    assert_read_or_refused(path)


@fuzzed
@given(PLAIN, st.sampled_from([".yaml", ".json"]))
def test_any_data(folder: Path, data: object, suffix: str) -> None:
    path = folder / f"data{suffix}"
    path.write_text(json.dumps(data), encoding="utf-8")
    assert_read_or_refused(path)


@fuzzed
@given(SENT.flatmap(lambda scenario: changed_data(scenario.to_dict())), st.sampled_from([".yaml", ".json"]))
def test_changed_data(folder: Path, data: dict[str, object], suffix: str) -> None:
    path = folder / f"changed{suffix}"
    path.write_text(json.dumps(data), encoding="utf-8")
    assert_read_or_refused(path)


@fuzzed
@given(SENT.flatmap(lambda scenario: changed_bytes(scenario.to_yaml().encode())))
def test_changed_bytes_of_yaml(folder: Path, content: bytes) -> None:
    path = folder / "changed_bytes.yaml"
    path.write_bytes(content)
    assert_read_or_refused(path)


@fuzzed
@given(SENT.flatmap(lambda scenario: changed_bytes(scenario.to_json().encode())))
def test_changed_bytes_of_json(folder: Path, content: bytes) -> None:
    path = folder / "changed_bytes.json"
    path.write_bytes(content)
    assert_read_or_refused(path)


NAMES = st.lists(
    st.one_of(
        st.sampled_from(
            [*specs(Scenario), "0", "1", "Bearing", "sigma", "start", "range", "motion", "position", "low"]
        ),
        st.text(max_size=5),
    ),
    min_size=1,
    max_size=4,
).map(".".join)
VALUES = st.one_of(st.text(), PLAIN.map(json.dumps), PLAIN.map(lambda data: yaml.safe_dump(data)))


@fuzzed
@given(SENT, st.lists(st.one_of(st.text(), st.tuples(NAMES, VALUES).map("=".join)), max_size=3))
def test_any_overrides(scenario: Scenario, words: list[str]) -> None:
    changed = read_or_refused(lambda: scenario.override(parse_overrides(words)))
    if changed is not None:
        assert Scenario.from_json(changed.to_json()) == changed
