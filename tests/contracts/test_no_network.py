"""Nothing that runs asks the network for anything."""

import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("stable_baselines3")

ROOT = Path(__file__).parents[2]
CLOSED = """
import socket, sys

def refuse(*arguments, **named):
    sys.stderr.write(f"asked the network: {arguments}\\n")
    raise OSError("there is no network")

for name in ("connect", "connect_ex", "sendto"):
    setattr(socket.socket, name, refuse)
for name in ("getaddrinfo", "gethostbyname", "create_connection"):
    setattr(socket, name, refuse)
from training.cli import main
for words in WORDS:
    status = main(words)
    assert status == 0, words
"""
SHORT = ["--override", "episode.steps=40"]
WORDS = [
    ["list", "-q"],
    ["new-scenario", "mine.yaml"],
    ["train", "mine.yaml", "--decisions", "1", "--out", "run", "-q"],
    [
        "evaluate",
        "BearingsOnly",
        "--policies",
        "run,learned,circle",
        "--episodes",
        "4",
        "--json",
        "e.json",
        "-q",
        *SHORT,
    ],
    ["report", "e.json", "--out", "e.html", "-q"],
    ["replay", "BearingsOnly", "--policy", "learned", "--gif", "r.gif", "--html", "r.html", "-q", *SHORT],
    ["observe", "BearingDopplerCase1b", "--out", "o.png", "-q"],
    ["export", "BearingsOnly", "--out", "flight", "-q", *SHORT],
    ["reproduce", "cross-fix", "--runs", "2", "--out", "papers", "-q"],
]


def test_commands_ask_the_network_for_nothing(tmp_path: Path) -> None:
    code = CLOSED.replace("WORDS", repr(WORDS))
    environment = {"PYTHONPATH": str(ROOT), "PATH": "/usr/bin:/bin", "HOME": str(tmp_path), "OMP_NUM_THREADS": "1"}
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False)
    assert "asked the network" not in done.stderr
    assert done.returncode == 0, done.stderr


def test_the_closed_network_would_be_noticed(tmp_path: Path) -> None:
    code = CLOSED.replace("WORDS", "[]") + "import urllib.request; urllib.request.urlopen('http://localhost:9')"
    words = [sys.executable, "-c", code]
    done = subprocess.run(words, cwd=ROOT, capture_output=True, text=True, check=False)
    assert "asked the network" in done.stderr
