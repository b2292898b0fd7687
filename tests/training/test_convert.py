"""Models of Stable-Baselines3 as agents: the same decisions, and nothing of their files is run."""

import io
import json
import os
import pickle
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")
import torch
from stable_baselines3 import A2C, PPO, SAC
from stable_baselines3.common.vec_env import VecNormalize

from agents import LearnedPolicy
from agents.agent_file import WEIGHTS, WEIGHTS_LIMIT
from passloc_env import SCENARIOS, observation_names
from passloc_env.errors import InputError
from passloc_env.sb3 import make_vec_env
from training.actor_weights import actor_layers
from training.convert import converted

SCENARIO = SCENARIOS["BearingsOnly"]
FEATURES = len(observation_names(SCENARIO))


def trained(name: str = "BearingsOnly", **policy: Any) -> PPO:
    """A model after two updates."""
    env = make_vec_env(name, n_envs=4, seed=0)
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=16, n_epochs=2, seed=0, device="cpu", policy_kwargs=policy)
    return model.learn(64)


@pytest.fixture(scope="module")
def model() -> PPO:
    return trained()


@pytest.fixture(scope="module")
def members(model: PPO) -> dict[str, bytes]:
    """The members of a model's file."""
    file = io.BytesIO()
    model.save(file)
    with zipfile.ZipFile(file) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


@pytest.fixture
def packed(members: dict[str, bytes], tmp_path: Path) -> Callable[..., Path]:
    """Writes a model's file with some members changed, or left out where they are None."""

    def packed(changes: dict[str, bytes | None]) -> Path:
        with zipfile.ZipFile(tmp_path / "model.zip", "w") as archive:
            for name, content in {**members, **changes}.items():
                if content is not None:
                    archive.writestr(name, content)
        return tmp_path / "model.zip"

    return packed


def refusal(path: Path, scenario: str = "BearingsOnly") -> str:
    with pytest.raises(InputError) as caught:
        converted(path, SCENARIOS[scenario])
    message = str(caught.value)
    assert message.startswith((str(path), f"cannot read {path}"))
    assert message.isprintable()
    assert len(message) < 700
    return message


def assert_same_decisions(model: Any, policy: LearnedPolicy) -> None:
    """1e-6: two float32 implementations of the same sums, actions of order one."""
    observation = np.random.default_rng(0).uniform(-10.0, 10.0, (300, FEATURES)).astype(np.float32)
    expected, _ = model.predict(observation, deterministic=True)
    np.testing.assert_allclose(policy.act(observation, None, None), expected, rtol=0, atol=1e-6)
    assert np.std(expected) > 0.01


@pytest.mark.parametrize("layers", [[64, 64], {"pi": [16, 8, 4], "vf": [8]}, []], ids=str)
def test_decisions_are_those_of_predict(layers: Any, passloc: Callable[..., Any], tmp_path: Path) -> None:
    model = trained(net_arch=layers)
    with torch.no_grad():
        model.policy.action_net.weight.mul_(20.0)
    model.save(tmp_path / "model.zip")
    status, out, _ = passloc("convert", "model.zip", "--scenario", "BearingsOnly", "--out", "agent")
    assert (status, out) == (0, "the agent is in agent\n")
    assert_same_decisions(model, LearnedPolicy.load(tmp_path / "agent", SCENARIO))


def test_an_agent_with_changed_weights_is_not_judged(model: PPO, refused: Callable[..., str], tmp_path: Path) -> None:
    model.save(tmp_path / "model.zip")
    converted(tmp_path / "model.zip", SCENARIO).save(tmp_path)
    weights = bytearray((tmp_path / WEIGHTS).read_bytes())
    weights[-1] ^= 1
    (tmp_path / WEIGHTS).write_bytes(weights)
    assert "was changed" in refused("evaluate", "BearingsOnly", "--policies", f"circle,{tmp_path}")


def test_models_of_a2c_are_converted_too(tmp_path: Path) -> None:
    model = A2C("MlpPolicy", make_vec_env("BearingsOnly", n_envs=2, seed=0), seed=0, device="cpu").learn(20)
    model.save(tmp_path / "model.zip")
    assert_same_decisions(model, LearnedPolicy(converted(tmp_path / "model.zip", SCENARIO)))


class Payload:
    """What a pickle may hold: a call, made when it is opened."""

    def __init__(self, trace: Path) -> None:
        self.trace = trace

    def __reduce__(self) -> tuple[Callable[..., Any], tuple[Any, ...]]:
        return os.mkdir, (str(self.trace),)


def test_a_payload_in_the_settings_is_not_run(packed: Any, members: dict[str, bytes], tmp_path: Path) -> None:
    """It stands where Stable-Baselines3 itself would open it; the model is converted all the same."""
    from base64 import b64encode

    settings = json.loads(members["data"])
    payload = b64encode(pickle.dumps(Payload(tmp_path / "run"))).decode()
    for setting in settings.values():
        if isinstance(setting, dict) and ":serialized:" in setting:
            setting[":serialized:"] = payload
    path = packed({"data": json.dumps(settings).encode()})
    assert converted(path, SCENARIO).card["architecture"]["actor"] == [FEATURES, 64, 64, 1]
    assert not (tmp_path / "run").exists()
    with pytest.raises(FileExistsError):  # By the second of the payloads.
        PPO.load(path, device="cpu")
    assert (tmp_path / "run").exists()


@pytest.mark.parametrize("form", ["archive", "legacy", "optimizer"])
def test_a_payload_in_the_weights_is_not_run(form: str, packed: Any, members: dict[str, bytes], tmp_path: Path) -> None:
    weights, file = torch.load(io.BytesIO(members["policy.pth"]), weights_only=True), io.BytesIO()
    torch.save({**weights, "log_std": Payload(tmp_path / "run")}, file, _use_new_zipfile_serialization=form != "legacy")
    if form == "optimizer":
        assert converted(packed({"policy.optimizer.pth": file.getvalue()}), SCENARIO).layers
    else:
        message = refusal(packed({"policy.pth": file.getvalue()}))
        assert "damaged, or hold more than weights" in message or "not an archive" in message
    assert not (tmp_path / "run").exists()


def test_statistics_are_refused_with_a_way_out(tmp_path: Path) -> None:
    VecNormalize(make_vec_env("BearingsOnly", n_envs=2, seed=0)).save(str(tmp_path / "vecnormalize.pkl"))
    message = refusal(tmp_path / "vecnormalize.pkl")
    assert "fold them into the first layer" in message
    assert "or train without them" in message


def test_only_what_belongs_to_a_model(packed: Any, tmp_path: Path) -> None:
    for name in ("../../run", "/run", "run.py", "a\x1b[2J"):
        assert "an archive with " in refusal(packed({name: b""}))
    assert "without policy.pth" in refusal(packed({"policy.pth": None}))
    assert "data is not readable JSON" in refusal(packed({"data": b"[" * 100_000}))
    assert "data is not readable JSON" in refusal(packed({"data": b"[]"}))
    (tmp_path / "text.zip").write_bytes(b"text")
    assert "not an archive" in refusal(tmp_path / "text.zip")
    assert "cannot read" in refusal(tmp_path / "none.zip")
    os.mkfifo(tmp_path / "pipe.zip")
    assert "not a regular file" in refusal(tmp_path / "pipe.zip")
    with (
        zipfile.ZipFile(tmp_path / "bomb.zip", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("data", "w") as member,
    ):
        for _ in range(300):
            member.write(bytes(1 << 20))
    assert "MiB when it is unpacked" in refusal(tmp_path / "bomb.zip")


def test_weights_that_are_packed(packed: Any, members: dict[str, bytes]) -> None:
    """Torch would set aside whatever they claim to be."""
    file, whole = io.BytesIO(), zipfile.ZipFile(io.BytesIO(members["policy.pth"]))
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name in whole.namelist():
            archive.writestr(name, whole.read(name))
    assert "are packed" in refusal(packed({"policy.pth": file.getvalue()})) or "packed" in refusal(packed({}))


@pytest.mark.parametrize(
    ("name", "value", "words"),
    [
        ("action_net.bias", torch.full((1,), torch.nan), "not finite"),
        ("action_net.weight", torch.zeros(1, 63), "do not fit each other"),
        ("action_net.weight", torch.zeros(1, 64, dtype=torch.float64), "single precision"),
        ("action_net.weight", torch.zeros(1).expand(10**6, 10**6), "do not fit each other"),
        ("action_net.weight", torch.zeros(1, 64).to_sparse(), "single precision"),
        ("action_net.weight", [0.0], "single precision"),
        ("features_extractor.0.weight", torch.zeros(1), "only actors of plain layers"),
        ("mlp_extractor.policy_net.3.weight", torch.zeros(64, 64), "other layers"),
        ("log_std", None, None),
    ],
)
def test_weights_of_another_kind(name: str, value: Any, words: str | None, packed: Any, members: Any) -> None:
    weights, file = torch.load(io.BytesIO(members["policy.pth"]), weights_only=True), io.BytesIO()
    weights[name] = value
    torch.save(weights, file)
    path = packed({"policy.pth": file.getvalue()})
    if words is None:
        assert converted(path, SCENARIO).layers
    else:
        assert words in refusal(path)


def layers_of_one_number(hidden: int, width: int) -> bytes:
    """Weights of a file of a few kilobytes: as many hidden layers of that width, each a view of a single zero."""
    file, zero = io.BytesIO(), torch.zeros(1)
    names = [*(f"mlp_extractor.policy_net.{2 * i}" for i in range(hidden)), "action_net"]
    state = {f"{name}.weight": zero.expand(width, width) for name in names}
    torch.save(state | {f"{name}.bias": zero.expand(width) for name in names}, file)
    return file.getvalue()


@pytest.mark.parametrize(
    ("hidden", "width", "words"),
    [
        (1, 2896, "larger than those of an agent"),
        (16, 2048, "larger than those of an agent"),
        (99, 1, "100 layers, more than the 99"),
    ],
)
def test_weights_that_are_small_one_by_one(hidden: int, width: int, words: str) -> None:
    """Refused by what all of them claim together, before any is written out; each alone would be let through."""
    content = layers_of_one_number(hidden, width)
    assert 4 * width * width < WEIGHTS_LIMIT
    tracemalloc.start()
    with pytest.raises(InputError, match=words):
        actor_layers(content)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1 << 22


def test_the_deepest_actor_is_let_through() -> None:
    assert len(actor_layers(layers_of_one_number(98, 1))) == 99


def test_models_that_would_fly_otherwise(tmp_path: Path) -> None:
    for kind, words in (
        ({"activation_fn": torch.nn.ReLU}, "joins its layers by"),
        ({"features_extractor_kwargs": {}, "squash_output": True, "use_sde": True}, "squash_output"),
    ):
        model = PPO("MlpPolicy", make_vec_env("BearingsOnly", 2), n_steps=2, batch_size=4, device="cpu", use_sde=True)
        model.policy_kwargs = kind
        model.save(tmp_path / "model.zip")
        assert words in refusal(tmp_path / "model.zip")
    SAC("MlpPolicy", make_vec_env("BearingsOnly", 2), buffer_size=10, device="cpu").save(tmp_path / "sac.zip")
    assert "no model of PPO or A2C" in refusal(tmp_path / "sac.zip")


def test_spaces_of_another_scenario(packed: Any, members: dict[str, bytes]) -> None:
    assert "sees 17 features and decides 1 actions; DualArray offers 28" in refusal(packed({}), "DualArray")
    settings = json.loads(members["data"])
    settings["action_space"]["low"] = "[-2.]"
    assert "another action_space" in refusal(packed({"data": json.dumps(settings).encode()}))
    settings["observation_space"] = None
    assert "another observation_space" in refusal(packed({"data": json.dumps(settings).encode()}))
