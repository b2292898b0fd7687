"""The demo at its smallest: everything it promises is there, and nothing of anybody else's is gone."""

import io
import json
import struct
import zlib

import pytest

pytest.importorskip("stable_baselines3")
pytest.importorskip("matplotlib")

from rich.console import Console

from agents import AgentFile, default_policies, find_policy
from passloc_env import SCENARIOS
from training import demo as demo_module
from training.commands import Demo
from training.demo import demo
from training.hyperparameters import Hyperparameters

FILES = {
    ".lock",
    "agent.json",
    "agent.safetensors",
    "config.json",
    "curve.csv",
    "evaluation.json",
    "learning_curve.png",
    "report.html",
    "table.md",
    "tensorboard",
    "tracks.png",
}
TINY = Hyperparameters(decisions=512, environments=8, rollout=16, batch_size=64, epochs=1, network=(8,))


@pytest.fixture(scope="module")
def played(tmp_path_factory):
    """A demo of 512 decisions and 32 episodes: its folder, evaluation, and what it printed."""
    folder = tmp_path_factory.mktemp("demo") / "deep" / "demo"
    output = io.StringIO()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Hyperparameters, "for_scenario", classmethod(lambda cls, name: TINY))
        patch.setattr(demo_module, "console", Console(file=output, width=200))
        evaluation = demo(Demo(out=folder, decisions=512, episodes=32))
    return folder, evaluation, output.getvalue()


def png_size(content: bytes) -> tuple[int, int]:
    """Width and height of a PNG whose chunks are complete and undamaged."""
    assert content[:8] == b"\x89PNG\r\n\x1a\n"
    position, kinds = 8, []
    while position < len(content):
        length, kind = struct.unpack(">I4s", content[position : position + 8])
        body = content[position + 4 : position + 8 + length]
        assert zlib.crc32(body) == struct.unpack(">I", content[position + 8 + length : position + 12 + length])[0]
        kinds.append(kind)
        position += 12 + length
    assert (kinds[0], kinds[-1]) == (b"IHDR", b"IEND")
    return struct.unpack(">II", content[16:24])


def test_every_file_is_there(played):
    folder, _, output = played
    assert {path.name for path in folder.iterdir()} == FILES
    for name in ("table.md", "evaluation.json", "tracks.png", "learning_curve.png", "report.html"):
        assert name in output


@pytest.mark.parametrize(("name", "columns"), [("tracks.png", 4), ("learning_curve.png", 2)])
def test_pictures(played, name, columns):
    """Some hundred pixels per panel, not empty, and small enough for a README."""
    content = (played[0] / name).read_bytes()
    width, height = png_size(content)
    assert 300 * columns <= width <= 700 * columns
    assert 400 <= height <= 1200
    assert 20_000 < len(content) < 1_000_000


def test_table_holds_every_policy_and_the_agent(played):
    folder, evaluation, output = played
    scenario = SCENARIOS["BearingsOnly"]
    expected = {"learned (PPO)", *(find_policy(name, scenario).name for name in default_policies(scenario))}
    assert {verdict.policy for verdict in evaluation.verdicts} == expected
    table = (folder / "table.md").read_text(encoding="utf-8")
    rows = [line for line in table.splitlines() if line.startswith("|")][2:]
    assert {row.split("|")[1].strip() for row in rows} == expected
    assert "32 episodes" in table.splitlines()[0]
    assert "95 % intervals" in table
    assert all(name in output for name in expected)


def test_results_are_those_of_the_table(played):
    folder, evaluation, _ = played
    assert (folder / "evaluation.json").read_text(encoding="utf-8") == evaluation.to_json()
    data = json.loads(evaluation.to_json())
    assert (data["reference"], data["episodes"], len(data["policies"])) == ("learned (PPO)", 32, 9)
    assert AgentFile.load(folder).card["training"]["decisions"] == 512


def test_evaluation_meets_no_seed_of_the_training(played):
    _, evaluation, _ = played
    assert evaluation.seed + evaluation.episodes < 2**62


class Stopped(Exception):
    """Training would begin here."""


@pytest.fixture
def begin(monkeypatch):
    """The demo without its minutes: it looks after its folder and stops where training would begin."""

    def stop(*arguments, **named):
        raise Stopped

    monkeypatch.setattr(demo_module, "run", stop)

    def begin(folder):
        with pytest.raises(Stopped):
            demo(Demo(out=folder, decisions=512, episodes=32))

    return begin


@pytest.fixture
def refuse(begin):
    """The same for folders that the demo must not touch."""

    def refuse(folder):
        with pytest.raises(FileExistsError, match="--out") as caught:
            demo(Demo(out=folder, decisions=512, episodes=32))
        assert "\n" not in str(caught.value)

    return refuse


@pytest.mark.parametrize("name", ["notes.txt", "table.md", ".hidden", "agent.json"])
def test_a_folder_that_is_no_demo_is_left_alone(tmp_path, name, refuse):
    (tmp_path / name).write_text("precious", encoding="utf-8")
    refuse(tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == [name]


def test_a_training_run_is_no_demo(tmp_path, refuse):
    """A run folder has a configuration too; hours of training must not go for a demo."""
    for name in FILES - {"table.md", "evaluation.json", "tracks.png", "learning_curve.png", "report.html"}:
        (tmp_path / name).write_text("{}", encoding="utf-8")
    before = sorted(path.name for path in tmp_path.iterdir())
    refuse(tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == before


def test_somebodys_project_is_no_demo(tmp_path, refuse):
    """Other programs call their settings config.json as well."""
    (tmp_path / "config.json").write_text('{"editor": "ed"}', encoding="utf-8")
    (tmp_path / "src").mkdir()
    refuse(tmp_path)
    assert (tmp_path / "src").is_dir()


def test_an_earlier_demo_is_left_alone_too(tmp_path, refuse, begin, monkeypatch):
    """Named, it is refused; unnamed, the next one gets a number."""
    earlier = tmp_path / "runs" / "demo"
    earlier.mkdir(parents=True)
    for name in FILES - {"tensorboard"}:
        (earlier / name).write_text("old", encoding="utf-8")
    refuse(earlier)
    monkeypatch.chdir(tmp_path)
    begin(None)
    assert sorted(path.name for path in (tmp_path / "runs").iterdir()) == ["demo", "demo.1"]
    assert (earlier / "table.md").read_text(encoding="utf-8") == "old"


def test_an_empty_or_new_folder_is_used(tmp_path, begin):
    (tmp_path / "empty").mkdir()
    for name in ("empty", "new/deep"):
        begin(tmp_path / name)
        assert (tmp_path / name).is_dir()
