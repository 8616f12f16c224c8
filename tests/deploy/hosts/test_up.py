"""`tis up` with programs that stand in for the sides, on hosts of this machine: checks, ends, restarts, orphans."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from tests.deploy.commands import call
from tests.deploy.hosts.stand_ins import RUNS, SCENARIO, SIDES, WAITS, Stage, environment, soon

pytestmark = pytest.mark.live
Run = Callable[[Path], tuple[int, str]]
_BRIEF = ("--no-report", "--no-merge")  # no test here looks at what they make


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    stage = Stage(tmp_path)
    yield stage
    for side in SIDES:
        for pid in stage.pids(side):
            if Path(f"/proc/{pid}").exists():
                os.kill(pid, signal.SIGKILL)


def _start(file: Path) -> subprocess.Popen[str]:
    """Start `tis up` as a process of its own, for tests that send it a signal."""
    command = [sys.executable, "-m", "tis.deploy.cli.main", "up", str(file), "--run-dir", str(file.parent / "run")]
    return subprocess.Popen(
        [*command, *_BRIEF], cwd=file.parent, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        text=True,
    )  # fmt: skip


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs `tis up` in this process and returns its exit code and diagnostics."""

    def run_up(file: Path) -> tuple[int, str]:
        monkeypatch.chdir(file.parent)
        for name, value in environment().items():
            monkeypatch.setenv(name, value)
        code, _, err = call("up", str(file), "--run-dir", str(file.parent / "run"), *_BRIEF)
        return code, err

    return run_up


def test_faults_of_all_hosts_come_at_once_and_nothing_starts(run: Run, tmp_path: Path) -> None:
    stage = Stage(tmp_path, checks=True)
    file = stage.write(
        {},
        SCENARIO.replace("tcp/", "tls/") + "security: {kind: password, file: none.txt}\n",
        surgeon={"folder": "/proc"},
        netem={"tis": "/no/such/tis"},
        patient={"folder": str(tmp_path / "missing")},
    )
    code, err = run(file)
    assert code == 3
    assert "surgeon: this machine: /proc: cannot be written" in err
    assert "surgeon: this machine: none.txt: cannot be read: No such file or directory" in err
    assert "netem: this machine: `/no/such/tis` cannot be started: No such file or directory" in err
    assert f"patient: this machine: {tmp_path}/missing: working folder cannot be entered: No such file" in err
    assert not any(stage.pids(side) for side in SIDES)
    assert not (tmp_path / "run").exists()


def test_a_host_out_of_reach_or_of_another_version_hides_no_fault_of_another(run: Run, tmp_path: Path) -> None:
    (tmp_path / "known_hosts").touch()
    ssh: dict[str, object] = {"kind": "ssh", "address": "127.0.0.1", "port": 1, "known_hosts": "known_hosts"}
    other = tmp_path / "other.py"
    other.write_text("print('tis 0.0.1, eclipse-zenoh 1.0.0')\n")
    stage = Stage(tmp_path, checks=True)
    code, err = run(
        stage.write({}, surgeon=ssh, netem={"tis": f"{sys.executable} {other}"}, patient={"folder": "/proc"})
    )
    assert code == 3
    assert "surgeon: 127.0.0.1 port 1: cannot be reached: " in err
    assert "netem: this machine: must run the same versions as this host: tis " in err
    assert "it has tis 0.0.1, eclipse-zenoh 1.0.0" in err
    assert "patient: this machine: /proc: cannot be written" in err
    assert not any(stage.pids(side) for side in SIDES)


def test_a_side_that_fails_before_the_run_ends_the_others_and_leaves_no_folder(
    stage: Stage, run: Run, tmp_path: Path
) -> None:
    fails = "say('failed', exit_code=3, reasons=['netem: in use'])\nlog()\nsys.exit(3)\n"
    code, err = run(stage.write({"netem": fails, "surgeon": WAITS, "patient": WAITS}))
    assert code == 3
    assert "tis: netem: in use" in err
    assert stage.nobody_is_left()
    assert not (tmp_path / "run").exists()
    assert list((tmp_path / "work" / "runs").iterdir()) == []


def test_ctrl_c_ends_every_side_by_sigint_or_kills_it_and_the_logs_are_collected(
    stage: Stage, tmp_path: Path
) -> None:
    """The patient is frozen: it does not obey, and is killed after a while."""
    programs = dict.fromkeys(SIDES, RUNS + WAITS) | {"patient": RUNS + "os.kill(os.getpid(), signal.SIGSTOP)\n"}
    process = _start(stage.write(programs))
    logs = tmp_path / "work" / "runs"
    assert soon(lambda: len(list(logs.glob("*/*.mcap"))) == 3)
    (pid,) = stage.pids("patient")
    assert soon(lambda: "T (stopped)" in Path(f"/proc/{pid}/status").read_text())
    process.send_signal(signal.SIGINT)
    err = process.communicate(timeout=60)[1]
    assert "tis: interrupted" in err
    assert "Traceback" not in err
    assert {side: stage.was_interrupted(side) for side in SIDES} == {"surgeon": True, "netem": True, "patient": False}
    assert stage.nobody_is_left()
    assert {path.name for path in (tmp_path / "run").glob("*.mcap")} == {f"{side}.mcap" for side in SIDES}


def test_no_side_outlives_a_killed_tis_up(stage: Stage) -> None:
    process = _start(stage.write(dict.fromkeys(SIDES, RUNS + WAITS)))
    assert soon(lambda: all(stage.pids(side) for side in SIDES))
    process.kill()
    process.communicate(timeout=60)
    assert soon(stage.nobody_is_left)


def test_a_side_that_dies_is_started_again_where_the_file_allows_it_but_not_for_ever(
    stage: Stage, run: Run, tmp_path: Path
) -> None:
    """Surgeon and patient die whenever they run; only the surgeon may come again, in the same folder, and netem."""
    runs, dies = "say('running', duration_s=5.0)\n", "os.kill(os.getpid(), 9)\n"
    logs = "if n_starts < 3:\n    log('x')\nif n_starts == 3:\n    log('second', f'surgeon_{n_starts}.mcap')\n"
    # on a busy machine netem may be the first to begin
    starts = "(place / 'surgeon.pids').read_text() if (place / 'surgeon.pids').exists() else ''"
    goes_on = f"len(({starts}).split()) < 6 and time.monotonic() < until_s"
    waits = f"until_s = time.monotonic() + 60\nwhile {goes_on}:\n    time.sleep(0.1)\n"
    programs = {
        "surgeon": runs + logs + dies,
        "patient": runs + "log('x')\n" + dies,
        "netem": "time.sleep(0.3)\n" + RUNS + waits + "time.sleep(2)\n",  # a seventh would come within it
    }
    _, err = run(stage.write(programs, surgeon={"restart": True}, netem={"restart": True}))
    assert "surgeon (this machine): died, started again (2)" in err
    assert "patient: killed by SIGKILL" in err
    assert {side: len(stage.pids(side)) for side in SIDES} == {"surgeon": 6, "netem": 1, "patient": 1}
    assert (tmp_path / "run" / "surgeon.mcap").read_text() == "x"
    assert (tmp_path / "run" / "surgeon_3.mcap").read_text() == "second"


def test_a_dead_side_ends_the_others_where_the_scenario_says_so(stage: Stage, run: Run) -> None:
    programs = dict.fromkeys(SIDES, RUNS + WAITS) | {"patient": RUNS + "time.sleep(1)\nos.kill(os.getpid(), 9)\n"}
    _, err = run(stage.write(programs, SCENARIO + "on_peer_loss: end\n"))
    assert "tis: patient: killed by SIGKILL" in err
    assert "interrupted" not in err.partition("tis: ")[2]
    assert stage.nobody_is_left()


def test_what_a_side_prints_instead_of_events_is_shown(stage: Stage, run: Run) -> None:
    fails = "print('[red]x', file=sys.stderr)\nsys.exit(70)\n"
    code, err = run(stage.write({"patient": fails, "surgeon": WAITS, "netem": WAITS}))
    assert code == 70
    assert "patient: [red]x" in err
    assert "tis: [red]x" in err
