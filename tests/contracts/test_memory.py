"""What an environment of a large batch costs in memory."""

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[2]
PROMISE = 20e3
"""Bytes per environment at 240 sensor steps, peak."""

PROGRAM = """
import sys, tracemalloc
import numpy as np
from passloc_env import LocalisationVectorEnv
size = int(sys.argv[1])
actions = np.zeros((size, 1), np.float32)
tracemalloc.start()
env = LocalisationVectorEnv(size, "BearingDoppler")
assert env.scenario.episode.steps == 240
env.reset(seed=0)
for _ in range(4):
    env.step(actions)
print(tracemalloc.get_traced_memory()[1])
"""


def peak(size):
    """Peak of all that NumPy and Python have allocated in a process of its own, in bytes."""
    answer = subprocess.run(
        [sys.executable, "-W", "error", "-c", PROGRAM, str(size)],
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=True,
    )
    return int(answer.stdout)


def test_peak_per_environment():
    per_environment = (peak(4096) - peak(64)) / (4096 - 64)
    print(f"{per_environment / 1e3:.1f} kB per environment")
    # The measurement noise of an episode alone: 241 steps, a bearing and a Doppler shift.
    assert 241 * 2 * 8 < per_environment <= PROMISE
