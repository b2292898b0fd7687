"""Engines: every task is done once whatever happens to a worker, and where it was done changes nothing."""

import contextlib
import multiprocessing
import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
from ctrl_c import heed_ctrl_c
from work_for_engines import (
    PLACE,
    dawdle_from,
    fail,
    killed_always,
    killed_once,
    killed_while_answering,
    mark,
    marks,
    refuse,
    square,
    threads,
    who,
)

from passloc_env.errors import InputError, WorkerError
from training.commands.fields import Work
from training.engines import ALONE, ATTEMPTS, opened
from training.engines.local import Local

ROOT = Path(__file__).parents[2]
NUMBERS = [(number,) for number in range(7)]
SQUARES = {number: number * number for (number,) in NUMBERS}


@pytest.fixture(scope="module")
def local():
    """Two processes; tests that break them find new ones."""
    engine = Local(2)
    yield engine
    engine.close()


@pytest.fixture(scope="module", params=["alone", "local", "ray"])
def engine(request, local):
    if request.param == "alone":
        yield ALONE
        return
    if request.param == "local":
        yield local
        return
    pytest.importorskip("ray")
    # Workers look for the tests' own modules where this process does.
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        with opened(Work(engine="ray", workers=2)) as cluster:
            yield cluster


@pytest.fixture(params=["local", "ray"])
def elsewhere(request, local, place):
    """An engine that begins under the place's environment, which its workers get."""
    if request.param == "local":
        local.close()
        yield local
        return
    ray = pytest.importorskip("ray")
    ray.shutdown()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", os.pathsep.join(sys.path))
        with opened(Work(engine="ray", workers=2)) as cluster:
            yield cluster


@pytest.fixture
def place(tmp_path, monkeypatch):
    monkeypatch.setenv(PLACE, str(tmp_path))
    return tmp_path


def alive(process):
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    return True


def wait_for(condition):
    """Until something is so; a test that waits a minute for it fails."""
    for _ in range(1200):
        if condition():
            return
        time.sleep(0.05)
    pytest.fail("it never came to be")


def test_each_task_is_done_once(engine):
    found = list(engine.map(square, NUMBERS))
    assert len(found) == len(NUMBERS)
    assert dict(found) == SQUARES
    assert list(engine.map(square, [])) == []


def test_an_input_error_comes_through_word_for_word(engine):
    with pytest.raises(InputError, match=r"^number = 3 is not possible: must be another$"):
        list(engine.map(refuse, [(3,)]))
    assert dict(engine.map(square, NUMBERS)) == SQUARES


def test_another_error_ends_the_run_with_one_line(elsewhere):
    with pytest.raises(WorkerError) as caught:
        list(elsewhere.map(fail, [(3,)]))
    assert str(caught.value) == "a task failed: ZeroDivisionError: task 3"
    assert "with a second line" in caught.value.__notes__[0]


def test_a_killed_worker_is_replaced_and_nothing_is_lost(elsewhere):
    found = list(elsewhere.map(killed_once, [(number, 3) for (number,) in NUMBERS]))
    assert sorted(found) == sorted(SQUARES.items())
    assert len(marks("3.*")) == 2
    assert sum(len(marks(f"{number}.*")) for (number,) in NUMBERS) == len(NUMBERS) + 1


def test_a_worker_killed_in_the_middle_of_its_answer_is_replaced(local, place):
    local.close()
    answers = local.map(killed_while_answering, [(0, 1), (1, 1)])
    assert next(answers) == (0, bytes(20_000_000))
    wait_for(lambda: marks("1.*"))
    mark("go")
    mortal = int(marks("1.*")[0].partition(".")[2])
    wait_for(lambda: mortal not in {child.pid for child in multiprocessing.active_children()})
    assert list(answers) == [(1, bytes([1]) * 20_000_000)]
    assert len(marks("1.*")) == 2


def test_a_task_that_ends_every_worker_is_given_up(elsewhere):
    with pytest.raises(WorkerError, match=f"task 0 has ended {ATTEMPTS} workers, the last by ") as caught:
        list(elsewhere.map(killed_always, [(0,)]))
    assert "\n" not in str(caught.value)
    assert len(marks()) == ATTEMPTS
    assert dict(elsewhere.map(square, NUMBERS)) == SQUARES


def test_workers_that_lack_our_modules_are_no_dead_ones(monkeypatch):
    ray = pytest.importorskip("ray")
    ray.shutdown()
    monkeypatch.delenv("PYTHONPATH", raising=False)
    said = r"^task 0 could not be done: ModuleNotFoundError: No module named 'work_for_engines'$"
    with opened(Work(engine="ray", workers=1)) as cluster, pytest.raises(WorkerError, match=said):
        list(cluster.map(square, NUMBERS))


def test_processes_are_kept_and_use_one_thread(local):
    first = {process for _, process in local.map(who, [()] * 4)}
    assert len(first) == 2
    assert os.getpid() not in first
    assert {process for _, process in local.map(who, [()] * 4)} == first
    assert {count for _, count in local.map(threads, [()])} == {"1"}


def test_who_stops_asking_ends_the_tasks(elsewhere):
    """One task is done and the other never would be; in Ray too, which aborts if tasks are cancelled one by one."""
    answers = elsewhere.map(dawdle_from, [(0, 1), (1, 1)])
    assert next(answers) == (0, 0)
    wait_for(lambda: marks("1.*"))
    answers.close()
    worker = int(marks("1.*")[0].partition(".")[2])
    wait_for(lambda: not alive(worker))
    assert dict(elsewhere.map(square, NUMBERS)) == SQUARES


@pytest.fixture
def dawdling(place):
    """A process of its own with two workers, which are in the middle of tasks that never end, and the workers' ids."""
    program = (
        "from training.engines.local import Local\n"
        "from work_for_engines import dawdle\n"
        "if __name__ == '__main__':\n"
        "    list(Local(2).map(dawdle, [(0,), (1,)]))\n"
    )
    script = place / "script.py"
    script.write_text(program, encoding="utf-8")
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests")])
    process = subprocess.Popen(
        [sys.executable, str(script)],
        env={**os.environ, "PYTHONPATH": path},
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
        preexec_fn=heed_ctrl_c,
    )
    wait_for(lambda: len(marks("[01].*")) == 2)
    yield process, [int(name.partition(".")[2]) for name in marks("[01].*")]
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)


def test_ctrl_c_ends_all_workers(dawdling):
    """A terminal sends it to every process of the group; the workers leave it to the first one."""
    process, workers = dawdling
    os.killpg(process.pid, signal.SIGINT)
    _, said = process.communicate(timeout=60)
    assert said.count("Traceback") == 1
    assert said.rstrip().endswith("KeyboardInterrupt")
    assert not any(alive(worker) for worker in workers)


def test_workers_end_with_a_killed_parent(dawdling):
    """Nobody is left to end them, and they are in the middle of a task."""
    process, workers = dawdling
    process.kill()
    process.communicate(timeout=60)
    wait_for(lambda: not any(alive(worker) for worker in workers))


@pytest.mark.parametrize(
    ("work", "said"),
    [
        (Work(workers=0), "workers = 0"),
        (Work(engine="ray", workers=-1), "workers = -1"),
        (Work(address="auto"), "for --engine ray"),
    ],
    ids=str,
)
def test_what_cannot_be_opened(work, said):
    with pytest.raises(InputError, match=said), opened(work):
        pass


def test_one_worker_is_this_process():
    with opened(Work()) as engine:
        assert engine is ALONE
    with opened(Work(workers=1)) as engine:
        assert engine is ALONE
    with opened(Work(workers=2)) as engine:
        assert engine.workers == 2


def refusal(address):
    """What somebody is told who wants to use the cluster at an address."""
    ray = pytest.importorskip("ray")
    ray.shutdown()
    with pytest.raises(InputError) as caught, opened(Work(engine="ray", address=address)):
        pass
    said = str(caught.value)
    assert said.startswith(f"address = {address!r} is not possible: ")
    assert "\n" not in said
    return said


def test_no_cluster_of_this_machine(monkeypatch):
    monkeypatch.setenv("RAY_gcs_rpc_server_reconnect_timeout_s", "1")
    assert refusal("auto")


def test_an_address_where_nobody_listens(capfd):
    with socket.socket() as taken:
        # Bound, so that nobody else gets the port, and not listening.
        taken.bind(("127.0.0.1", 0))
        assert "nobody answers there" in refusal(f"127.0.0.1:{taken.getsockname()[1]}")
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("address", ["local", "127.0.0.1:x", "127.0.0.1:99999", ":6379", "[::1", "ray://"])
def test_what_is_no_address(address):
    assert "a cluster is at host:port, or auto" in refusal(address)


@pytest.fixture
def guarded(tmp_path, monkeypatch):
    """The address of a cluster that lets in who has its token, which this process could find."""
    pytest.importorskip("ray")
    token = tmp_path / "token"
    token.write_text("0123456789abcdef" * 2, encoding="utf-8")
    monkeypatch.setenv("RAY_AUTH_TOKEN_PATH", str(token))
    # Ray sets it where a cluster has been started.
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    with socket.socket() as free:
        free.bind(("127.0.0.1", 0))
        port = free.getsockname()[1]
    words = ["start", "--head", "--block", "--include-dashboard=false", "--num-cpus=1", f"--port={port}"]
    process = subprocess.Popen(
        [sys.executable, "-m", "ray.scripts.scripts", *words],
        env={**os.environ, "RAY_AUTH_MODE": "token", "PYTHONPATH": os.pathsep.join(sys.path)},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    wait_for(lambda: answers(port))
    yield f"127.0.0.1:{port}"
    process.terminate()
    process.wait()


def answers(port):
    with socket.socket() as caller:
        return caller.connect_ex(("127.0.0.1", port)) == 0


COUNT = (
    "from training.commands.fields import Work\n"
    "from training.engines import opened\n"
    "from work_for_engines import square\n"
    "import sys\n"
    "with opened(Work(engine='ray', address=sys.argv[1])) as cluster:\n"
    "    print(dict(cluster.map(square, [(3,), (4,)])))\n"
)


def test_a_cluster_with_a_token(guarded):
    """Ray reads the token once in a process, hence those of their own."""
    path = os.pathsep.join([str(ROOT), str(ROOT / "tests"), *sys.path])

    def said(**settings):
        environment = {**os.environ, "PYTHONPATH": path, **settings}
        words = [sys.executable, "-c", COUNT, guarded]
        return subprocess.run(words, env=environment, capture_output=True, text=True, timeout=120)

    let_in = said(RAY_AUTH_MODE="token")
    assert (let_in.stdout, let_in.stderr) == ("{0: 9, 1: 16}\n", "")
    refused = said()
    assert refused.stderr.splitlines()[-1].endswith("have its ~/.ray/auth_token on this machine")
    assert "InvalidAuthToken" not in refused.stderr
