"""Files and texts of strangers: refused in one line, at once, whatever they promise to become."""

import json
import os
import tracemalloc
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
import yaml

from passloc_env import Scenario, ScenarioError
from passloc_env.errors import InputError
from passloc_env.reading import TEXT_LIMIT, json_data, read_bytes, read_text, yaml_data

NINE = ",".join(["*{}"] * 9)
LAUGHS = "a: &a [x]\n" + "".join(
    f"{new}: &{new} [{NINE.format(*old * 9)}]\n" for old, new in zip("abcdefghijk", "bcdefghijkl", strict=True)
)
MERGES = "a: &a {k: 1}\n" + "".join(
    f"{new}: &{new} {{<<: [{NINE.format(*old * 9)}]}}\n" for old, new in zip("abcdefghijk", "bcdefghijkl", strict=True)
)


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (LAUGHS, "more than 50000 values"),
        (MERGES, "more than 50000 values"),
        ("a: &x [*x]", "an alias stands inside what it stands for"),
        ("a: &x {b: {c: *x}}", "an alias stands inside what it stands for"),
        ("[" * 100_000, "nested more than 50 deep"),
        ("- " * 100_000, "nested more than 50 deep"),
        ("!!python/object/apply:os.system ['touch run']", "could not determine a constructor"),
        ("!!python/name:os.system ''", "could not determine a constructor"),
        ("steps: 1\nsteps: 2", "'steps' stands there twice"),
        ("0x" + "f" * 200, "more than 100 digits"),
        ("9" * 5000, "digits"),
        ("2001-99-99", "month"),
        ("!!int ''", "index"),
        ("!!timestamp x", "NoneType"),
        ("!!int 1:30", "'1:30' is no number"),
        ("!!float {=: 1:30}", "'1:30' is no number"),
        ('"\\ud800"', "half a character"),
        ("? [a]\n: 1", "unhashable key"),
        ("a\x00b", "special characters"),
    ],
)
def test_hostile_yaml(text: str, reason: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    refused(lambda: yaml_data(text), reason)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("[" * 100_000, "nested more than 50 deep"),
        ("[" * 60 + "]" * 60, "nested more than 50 deep"),
        ('{"a":' * 100_000, "nested more than 50 deep"),
        ("[" + "[]," * 60_000 + "[]]", "more than 50000 values"),
        ('{"a": 1, "a": 2}', "'a' stands there twice"),
        ("9" * 101, "more than 100 digits"),
        ("9" * 5000, "digits"),
        ("1e999", "'1e999' is no finite number"),
        ("NaN", "'NaN' is no finite number"),
        ("[-Infinity]", "'-Infinity' is no finite number"),
        ('{"\\ud800": 1}', "half a character"),
        ("", "Expecting value"),
    ],
)
def test_hostile_json(text: str, reason: str) -> None:
    refused(lambda: json_data(text), reason)


@pytest.mark.parametrize("text", [LAUGHS, MERGES, "[" * 100_000, "- " * 100_000])
def test_little_memory_goes_into_it(text: str) -> None:
    """32 MiB, for texts of which the shortest would take the most memory there is."""
    tracemalloc.start()
    refused(lambda: yaml_data(text))
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 1 << 25


def test_aliases_within_reason_are_read() -> None:
    text = "near: &near {low: 1, high: 2}\nfar: {<<: *near, high: 3}\nalso: *near"
    near = {"low": 1, "high": 2}
    assert yaml_data(text) == {"near": near, "far": {"low": 1, "high": 3}, "also": near}


@pytest.mark.parametrize("scenario", [Scenario()], ids=lambda scenario: scenario.name)
def test_what_we_write_is_read(scenario: Scenario) -> None:
    assert yaml_data(scenario.to_yaml()) == json_data(scenario.to_json()) == scenario.to_dict()
    assert json_data(json.dumps({"a": [1.5, -0.0, None, True, "ä", 10**99]}))["a"][-1] == 10**99


def test_only_regular_files_are_read(tmp_path: Path) -> None:
    """A pipe that nobody writes into would never open, a device never end."""
    os.mkfifo(tmp_path / "pipe")
    (tmp_path / "circle").symlink_to("circle")
    for path in (tmp_path, tmp_path / "pipe", Path("/dev/zero"), tmp_path / "circle", tmp_path / "none", Path("a\0b")):
        with pytest.raises(OSError, match=r"Errno") as caught:
            read_text(path)
        assert caught.value.strerror


def test_a_large_file_is_not_read_whole(tmp_path: Path) -> None:
    """A file of 1 TiB, all of it a hole."""
    with (tmp_path / "large").open("wb") as file:
        file.truncate(1 << 40)
    tracemalloc.start()
    with pytest.raises(OSError, match=r"larger than the 1024 KiB"):
        read_text(tmp_path / "large")
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 4 * TEXT_LIMIT
    (tmp_path / "just").write_bytes(bytes(8))
    assert read_bytes(tmp_path / "just", 8) == bytes(8)
    with pytest.raises(OSError, match="larger than the 0 KiB"):
        read_bytes(tmp_path / "just", 7)


@pytest.mark.parametrize("name", ["../x", "/etc/x", "a\\b", ".hidden", "", "a\nb", "\x1b[2J", "x" * 101, "a\u202eb"])
def test_names_that_lead_elsewhere(name: str) -> None:
    """Run folders are called after scenarios."""
    with pytest.raises(ScenarioError, match=r"^name = .*printable characters") as caught:
        Scenario.from_dict({"name": name})
    assert str(caught.value).isprintable()


def test_episodes_that_would_be_divided_for_ever() -> None:
    with pytest.raises(ScenarioError, match=r"^episode.steps = .* at most 1000000$"):
        Scenario.from_dict({"episode": {"steps": 10**90 + 7}})


@pytest.mark.parametrize("data", [{"a\nb": 1}, {"sensors": [{"type": "x\x1b"}]}, {"name": ["x"] * 10_000}])
def test_messages_are_one_short_line(data: dict[str, Any]) -> None:
    with pytest.raises(ScenarioError) as caught:
        Scenario.from_dict(data)
    message = str(caught.value)
    assert message.isprintable()
    assert len(message) < 2000


def test_numbers_to_base_60_are_texts() -> None:
    """Such a number takes time with the square of its length; all other numbers are those of PyYAML."""
    for text in ("1:1:1", "-1:30", "1:30.5", "1" + ":1" * 100_000):
        assert yaml_data(f"a: {text}") == {"a": text}
    others = "[12, -7, 1_000, 0x1F, 0b11, 017, 1.5, -.5, 1.0e+3, .inf, 1e3, 2001-12-14 21:59:43, 2001-12-14]"
    assert yaml_data(others) == yaml.safe_load(others)
    with pytest.raises(ScenarioError, match=r"^episode.steps = '1:1:1' "):
        Scenario.from_dict(yaml_data("episode: {steps: 1:1:1}"))


def refused(read: Callable[[], Any], reason: str = "") -> None:
    with pytest.raises(InputError) as caught:
        read()
    message = str(caught.value)
    assert reason in message
    assert message.isprintable()
    assert len(message) < 500
