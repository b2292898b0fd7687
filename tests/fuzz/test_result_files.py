"""Results, hyperparameters and archives of strangers: read as they were written, or one line."""

import dataclasses
import io
import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
import yaml
from fuzzing import BYTES, PLAIN, changed_bytes, changed_data, fuzzed, read_or_refused
from hypothesis import given
from hypothesis import strategies as st

pytest.importorskip("stable_baselines3")
from stable_baselines3 import PPO

from agents import find_policy
from passloc_env import SCENARIOS
from passloc_env.sb3 import make_vec_env
from training.archives import read_arrays
from training.convert import converted
from training.curve import COLUMNS, read_curve
from training.evaluate import evaluate, read_evaluation
from training.hyperparameters import Hyperparameters

SCENARIO = SCENARIOS["BearingsOnly"].override({"episode.steps": 8})
EVALUATION = evaluate(SCENARIO, [find_policy(name, SCENARIO) for name in ("circle", "straight")], episodes=2).to_dict()
PARAMETERS = dataclasses.asdict(Hyperparameters()) | {"network": [8, 8], "families": [{"episode.steps": 8}]}


def model() -> bytes:
    """A model of Stable-Baselines3, as its file is."""
    file = io.BytesIO()
    PPO("MlpPolicy", make_vec_env("BearingsOnly", 2, seed=0), n_steps=2, batch_size=4, seed=0, device="cpu").save(file)
    return file.getvalue()


def arrays() -> bytes:
    """An archive of two arrays, as its file is."""
    file = io.BytesIO()
    np.savez_compressed(file, numbers=np.arange(6.0).reshape(2, 3), words=np.array("about"))
    return file.getvalue()


MODEL, ARRAYS = model(), arrays()


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("results")


def assert_evaluation_read_or_refused(path: Path) -> None:
    found = read_or_refused(lambda: read_evaluation(path))
    if found is not None:
        found.save(path)
        assert read_evaluation(path).to_json() == found.to_json()


@fuzzed
@given(st.one_of(BYTES, PLAIN.map(lambda data: json.dumps(data).encode())))
def test_anything_for_an_evaluation(folder: Path, content: bytes) -> None:
    path = folder / "any.json"
    path.write_bytes(content)
    assert_evaluation_read_or_refused(path)


@fuzzed
@given(
    st.one_of(
        changed_data(EVALUATION).map(lambda data: json.dumps(data).encode()),
        changed_bytes(json.dumps(EVALUATION).encode()),
    )
)
def test_changed_evaluations(folder: Path, content: bytes) -> None:
    path = folder / "changed.json"
    path.write_bytes(content)
    assert_evaluation_read_or_refused(path)


@fuzzed
@given(
    st.one_of(
        BYTES, PLAIN.map(lambda data: yaml.safe_dump(data).encode()), changed_bytes(yaml.safe_dump(PARAMETERS).encode())
    )
)
def test_anything_for_hyperparameters(folder: Path, content: bytes) -> None:
    path = folder / "any.yaml"
    path.write_bytes(content)
    read_or_refused(lambda: Hyperparameters.load(path))


@fuzzed
@given(changed_data(PARAMETERS))
def test_changed_hyperparameters(folder: Path, data: object) -> None:
    path = folder / "changed.yaml"
    path.write_text(json.dumps(data), encoding="utf-8")
    found = read_or_refused(lambda: Hyperparameters.load(path))
    if found is not None:
        plain = dataclasses.asdict(found)
        path.write_text(yaml.safe_dump(plain | {name: list(plain[name]) for name in ("network", "families")}))
        assert Hyperparameters.load(path) == found


@fuzzed
@given(st.one_of(BYTES, changed_bytes(",".join(COLUMNS).encode() + b"\n256,0.1,-3.0,60,0.5\n512,0.2,-2.0,60,0.25\n")))
def test_anything_for_a_curve(folder: Path, content: bytes) -> None:
    path = folder / "curve.csv"
    path.write_bytes(content)
    found = read_or_refused(lambda: read_curve(path))
    assert found is None or set(found) == set(COLUMNS)


@fuzzed
@given(st.one_of(BYTES, changed_bytes(ARRAYS)))
def test_anything_for_an_archive_of_arrays(folder: Path, content: bytes) -> None:
    path = folder / "any.npz"
    path.write_bytes(content)
    found = read_or_refused(lambda: read_arrays(path, ("numbers", "words")))
    assert found is None or found.keys() == {"numbers", "words"}


@fuzzed
@given(changed_bytes(zipfile.ZipFile(io.BytesIO(ARRAYS)).read("numbers.npy")))
def test_changed_arrays(folder: Path, content: bytes) -> None:
    path = folder / "changed.npz"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("numbers.npy", content)
    found = read_or_refused(lambda: read_arrays(path, ("numbers",)))
    assert found is None or found["numbers"].nbytes < len(content)


@fuzzed
@given(changed_bytes(MODEL))
def test_changed_models(folder: Path, content: bytes) -> None:
    path = folder / "changed.zip"
    path.write_bytes(content)
    read_or_refused(lambda: converted(path, SCENARIO))


@fuzzed
@given(st.sampled_from(["data", "policy.pth"]), st.data())
def test_changed_members_of_models(folder: Path, name: str, data: st.DataObject) -> None:
    path, whole = folder / "member.zip", zipfile.ZipFile(io.BytesIO(MODEL))
    with zipfile.ZipFile(path, "w") as archive:
        for each in whole.namelist():
            content = whole.read(each)
            archive.writestr(each, data.draw(changed_bytes(content)) if each == name else content)
    read_or_refused(lambda: converted(path, SCENARIO))
