"""Agents of strangers: whatever lies where an agent should, it is refused in one line, and nothing in it is run."""

import io
import json
import os
import pickle
import shutil
import struct
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("safetensors")
from safetensors.numpy import save

from agents import AgentFile, AgentFileError, LearnedPolicy, find_policy
from agents.agent_file import CARD, WEIGHTS
from agents.shipped import FOLDER, shipped_agents
from passloc_env import SCENARIOS

SCENARIO = SCENARIOS["DualArray"]
GOOD = json.loads((FOLDER / "DualArray" / CARD).read_text(encoding="utf-8"))
ACTOR = GOOD["architecture"]["actor"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(FOLDER / "DualArray", tmp_path / "agent")
    return tmp_path / "agent"


def edit(folder: Path, **changes: Any) -> None:
    """Change entries of the card, which no longer vouches for its weights."""
    card = {**GOOD, **changes}
    card.pop("weights_sha256")
    (folder / CARD).write_text(json.dumps(card), encoding="utf-8")


def refusal(path: Path, words: str = "") -> str:
    """The one line with which an agent is refused, before more than 16 MiB have gone into it."""
    tracemalloc.start()
    with pytest.raises(AgentFileError) as caught:
        LearnedPolicy.load(path, SCENARIO)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    message = str(caught.value)
    assert words in message
    assert message.isprintable()
    assert len(message) < 1000
    assert peak < 1 << 24
    return message


class Payload:
    """What a pickle may hold: a call, made when it is opened."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return os.mkdir, (str(self.trace),)


@pytest.fixture
def trace(tmp_path: Path) -> Path:
    """The folder that a payload makes when it is run; the payload does work."""
    pickle.loads(pickle.dumps(Payload(tmp_path / "works")))
    assert (tmp_path / "works").is_dir()
    return tmp_path / "run"


@pytest.mark.parametrize("name", [CARD, WEIGHTS])
@pytest.mark.parametrize("form", ["pickle", "torch", "npz", "joined"])
def test_planted_pickles_are_not_opened(folder: Path, trace: Path, name: str, form: str) -> None:
    content, file = pickle.dumps(Payload(trace)), io.BytesIO()
    if form == "torch":
        with zipfile.ZipFile(file, "w") as archive:
            archive.writestr("archive/data.pkl", content)
        content = file.getvalue()
    elif form == "npz":
        np.savez(file, a=np.array([Payload(trace)], dtype=object))
        content = file.getvalue()
    elif form == "joined":
        content = (folder / name).read_bytes() + content
    edit(folder)
    (folder / name).write_bytes(content)
    refusal(folder, name)
    assert not trace.exists()


def test_an_archive_of_zeros(folder: Path) -> None:
    """64 KiB that would be 64 MiB."""
    for name in (CARD, WEIGHTS):
        edit(folder)
        with zipfile.ZipFile(folder / name, "w", zipfile.ZIP_DEFLATED) as archive:
            archive.writestr("zeros", bytes(1 << 26))
        refusal(folder, name)


def tensors(header: Any, data: bytes = bytes(16), length: int | None = None) -> bytes:
    text = header if isinstance(header, bytes) else json.dumps(header).encode()
    return struct.pack("<Q", len(text) if length is None else length) + text + data


ONE: dict[str, Any] = {"dtype": "F32", "shape": [4], "data_offsets": [0, 16]}


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\x00" * 7,
        tensors({"a": ONE | {"shape": [-4]}}),
        tensors({"a": ONE | {"shape": [2**62, 4]}}),
        tensors({"a": ONE | {"shape": [10**30]}}),
        tensors({"a": ONE | {"shape": [0, 2**62], "data_offsets": [0, 0]}}, b""),
        tensors({"a": {"dtype": "F32", "data_offsets": [0, 16]}}),
        tensors({"a": ONE | {"dtype": "BF16", "shape": [8]}}),
        tensors({"a": ONE | {"dtype": "O"}}),
        tensors({"a": ONE | {"data_offsets": [0, 2**64 - 1]}}),
        tensors({"a": ONE | {"data_offsets": [16, 0]}}),
        tensors({"a": ONE, "b": ONE}),
        tensors({"a": ONE}, bytes(20)),
        tensors({"a": ONE}, length=2**64 - 1),
        tensors({"a": ONE}, length=10**8),
        tensors({f"{i}": ONE | {"shape": [0], "data_offsets": [0, 0]} for i in range(2000)}, b""),
        tensors(b'{"a":' * 10_000),
        tensors(b"\xff\xfe"),
    ],
)
def test_hostile_headers(folder: Path, content: bytes) -> None:
    edit(folder)
    (folder / WEIGHTS).write_bytes(content)
    refusal(folder, "is not a readable safetensors file")


@pytest.mark.parametrize("kind", [np.float64, np.float16, np.int32, np.complex64, bool])
def test_weights_of_another_type(folder: Path, kind: type) -> None:
    edit(folder)
    weights = AgentFile.load(FOLDER / "DualArray").weights
    (folder / WEIGHTS).write_bytes(save({name: array.astype(kind) for name, array in weights.items()}))
    refusal(folder, "does not hold the actor")


def test_a_file_far_larger_than_an_agent(folder: Path) -> None:
    edit(folder)
    for name in (WEIGHTS, CARD):
        with (folder / name).open("r+b") as file:
            file.truncate(1 << 40)
        refusal(folder, f"{name}: larger than the")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"architecture": {"actor": [ACTOR[0], 10**9, ACTOR[-1]]}}, "does not hold the actor"),
        ({"architecture": {"actor": [ACTOR[0], *[64] * 40_000, ACTOR[-1]]}}, "2 to 100 layer sizes"),
        ({"architecture": {"actor": [True, 64, 1]}}, "layer sizes"),
        ({"architecture": {"actor": [ACTOR[0], -64, 1]}}, "layer sizes"),
        ({"architecture": {"actor": [ACTOR[0]]}}, "layer sizes"),
        ({"architecture": {"actor": ACTOR, "critic": ACTOR}}, "must hold an actor"),
        ({"observation": GOOD["observation"][::-1]}, "observation is not what DualArray offers"),
        ({"observation": {"a": 1}}, "list of names"),
        ({"choices": 10**50}, "multiple of its"),
        ({"choices": True}, "choices"),
        ({"mirror": "yes"}, "mirror"),
        ({"shield_sigmas": -1}, "shield_sigmas"),
        ({"flies": ["a\x1b[2J"]}, "flies"),
        ({"training": []}, "training"),
        ({"training": {"command": 3}}, "training"),
        ({"scenario": {"name": "../../x"}}, "name = '../../x' is not possible"),
        ({"scenario": {"a\nb": 1}}, "no such field"),
        ({"format": "passloc-agent-2"}, "is not the card"),
    ],
)
def test_hostile_cards(folder: Path, changes: dict[str, Any], words: str) -> None:
    edit(folder, **changes)
    refusal(folder, words)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("[" * 100_000, "nested more than 50 deep"),
        ('{"format": "passloc-agent-1", "format": "passloc-agent-1"}', "stands there twice"),
        ('{"format": "passloc-agent-1", "choices": ' + "9" * 5000 + "}", "digits"),
        ('{"format": "passloc-agent-1", "choices": 1e999}', "no finite number"),
        ('{"format": "\\ud800"}', "half a character"),
        ('{1: "format"}', "is not readable JSON"),
    ],
)
def test_cards_that_are_no_plain_json(folder: Path, text: str, words: str) -> None:
    (folder / CARD).write_text(text, encoding="utf-8")
    refusal(folder, words)


@pytest.mark.parametrize("name", [CARD, WEIGHTS])
@pytest.mark.parametrize("instead", ["pipe", "folder", "circle", "device"])
def test_what_is_no_file(folder: Path, name: str, instead: str) -> None:
    """Not a moment is waited for a pipe that nobody writes into."""
    edit(folder)
    (folder / name).unlink()
    if instead == "pipe":
        os.mkfifo(folder / name)
    elif instead == "folder":
        (folder / name).mkdir()
    else:
        (folder / name).symlink_to(name if instead == "circle" else "/dev/zero")
    refusal(folder, str(folder))


def test_a_card_vouches_for_its_weights(folder: Path) -> None:
    """One bit, far from what any check of shapes would see."""
    content = bytearray((folder / WEIGHTS).read_bytes())
    content[-1000] ^= 1
    (folder / WEIGHTS).write_bytes(content)
    message = refusal(folder, "agent.safetensors was changed: its SHA-256 is ")
    assert GOOD["weights_sha256"] not in message
    edit(folder)
    assert AgentFile.load(folder).card["architecture"] == GOOD["architecture"]


@pytest.mark.parametrize("name", shipped_agents())
def test_shipped_cards_vouch_for_their_weights(name: str) -> None:
    assert "weights_sha256" in AgentFile.load(FOLDER / name).card


@pytest.mark.parametrize("name", ["../../etc", "/etc", "DualArray/../DualArray", "", ".", "a\nb", "\x1b[2J"])
def test_names_of_shipped_agents_lead_nowhere_else(name: str) -> None:
    with pytest.raises(AgentFileError, match="no such shipped agent") as caught:
        find_policy(f"agent:{name}", SCENARIO)
    assert str(caught.value).isprintable()
