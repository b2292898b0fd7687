"""Agents of strangers: cards and weights that are whole when they are saved again, or one line."""

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from fuzzing import BYTES, PLAIN, changed_bytes, changed_data, fuzzed, read_or_refused
from hypothesis import given

from agents import AgentFile, LearnedPolicy
from agents.agent_file import CARD, WEIGHTS
from agents.shipped import FOLDER
from passloc_env import SCENARIOS, observation_names

pytest.importorskip("safetensors")

SHIPPED = FOLDER / "DualArray"
UNVOUCHED = json.loads((SHIPPED / CARD).read_text(encoding="utf-8"))
UNVOUCHED.pop("weights_sha256")
CONTENT = (SHIPPED / WEIGHTS).read_bytes()
HEADER = 8 + int.from_bytes(CONTENT[:8], "little")

Sent = Callable[[bytes, bytes], Path]


@pytest.fixture(scope="module")
def sent(tmp_path_factory: pytest.TempPathFactory) -> Sent:
    folder = tmp_path_factory.mktemp("agent")

    def sent(card: bytes, weights: bytes) -> Path:
        (folder / CARD).write_bytes(card)
        (folder / WEIGHTS).write_bytes(weights)
        return folder

    return sent


def assert_read_or_refused(folder: Path) -> None:
    """An agent that is read is the same when it is written, and flies the scenario it fits."""
    agent = read_or_refused(lambda: AgentFile.load(folder))
    policy = read_or_refused(lambda: LearnedPolicy.load(folder, SCENARIOS["DualArray"]))
    if agent is None:
        assert policy is None
        return
    agent.save(folder)
    again = AgentFile.load(folder)
    assert {**again.card, "weights_sha256": None} == {**agent.card, "weights_sha256": None}
    assert all(np.array_equal(again.weights[name], weights) for name, weights in agent.weights.items())
    if policy is not None:
        observation = np.zeros((2, len(observation_names(SCENARIOS["DualArray"]))), np.float32)
        assert policy.act(observation, None, None).shape == (2, SCENARIOS["DualArray"].action_size)


@fuzzed
@given(BYTES)
def test_any_bytes_for_a_card(sent: Sent, content: bytes) -> None:
    assert_read_or_refused(sent(content, CONTENT))


@fuzzed
@given(PLAIN)
def test_any_data_for_a_card(sent: Sent, data: object) -> None:
    assert_read_or_refused(sent(json.dumps(data).encode(), CONTENT))


@fuzzed
@given(changed_data(UNVOUCHED))
def test_changed_cards(sent: Sent, data: object) -> None:
    assert_read_or_refused(sent(json.dumps(data).encode(), CONTENT))


@fuzzed
@given(changed_bytes(json.dumps(UNVOUCHED).encode()))
def test_changed_bytes_of_a_card(sent: Sent, content: bytes) -> None:
    assert_read_or_refused(sent(content, CONTENT))


@fuzzed
@given(BYTES)
def test_any_bytes_for_weights(sent: Sent, content: bytes) -> None:
    assert_read_or_refused(sent(json.dumps(UNVOUCHED).encode(), content))


@fuzzed
@given(changed_bytes(CONTENT[:HEADER]))
def test_changed_headers_of_weights(sent: Sent, header: bytes) -> None:
    assert_read_or_refused(sent(json.dumps(UNVOUCHED).encode(), header + CONTENT[HEADER:]))


@fuzzed
@given(changed_data(json.loads(CONTENT[8:HEADER])))
def test_other_shapes_and_places_of_weights(sent: Sent, data: object) -> None:
    header = json.dumps(data).encode()
    content = len(header).to_bytes(8, "little") + header + CONTENT[HEADER:]
    assert_read_or_refused(sent(json.dumps(UNVOUCHED).encode(), content))
