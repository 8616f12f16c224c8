"""`tis up` with programs that stand in for the sides, on hosts of this machine: checks, ends, restarts, orphans."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.deploy.hosts.stand_ins import RUNS, SCENARIO, SIDES, WAITS, Stage, environment, soon

pytestmark = pytest.mark.live


@pytest.fixture
def stage(tmp_path: Path) -> Iterator[Stage]:
    stage = Stage(tmp_path)
    yield stage
    for side in SIDES:
        for pid in stage.pids(side):
            if Path(f"/proc/{pid}").exists():
                os.kill(pid, signal.SIGKILL)


def _start(file: Path, *words: str) -> subprocess.Popen[str]:
    command = [
        sys.executable,
        "-m",
        "deploy.cli.main",
        "up",
        str(file),
        "--run-dir",
        str(file.parent / "run"),
        *words,
    ]
    return subprocess.Popen(
        command, cwd=file.parent, env=environment(), stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )


def _run(file: Path, *words: str) -> tuple[int, str]:
    process = _start(file, *words)
    err = process.communicate(timeout=120)[1]
    assert "Traceback" not in err
    return process.returncode, err


def test_faults_of_all_hosts_come_at_once_and_nothing_starts(stage: Stage, tmp_path: Path) -> None:
    file = stage.write(
        {},
        SCENARIO.replace("tcp/", "tls/") + "security: {kind: password, file: none.txt}\n",
        surgeon={"folder": "/proc"},
        netem={"tis": "/no/such/tis"},
        patient={"folder": str(tmp_path / "missing")},
    )
    code, err = _run(file)
    assert code == 3
    assert "surgeon: this machine: /proc: cannot be written" in err
    assert "surgeon: this machine: none.txt: cannot be read: No such file or directory" in err
    assert "netem: this machine: `/no/such/tis` cannot be started: No such file or directory" in err
    assert f"patient: this machine: {tmp_path}/missing: working folder cannot be entered: No such file" in err
    assert not any(stage.pids(side) for side in SIDES)
    assert not (tmp_path / "run").exists()


def test_a_host_that_cannot_be_reached_hides_no_fault_of_another(stage: Stage, tmp_path: Path) -> None:
    (tmp_path / "known_hosts").touch()
    ssh: dict[str, object] = {"kind": "ssh", "address": "127.0.0.1", "port": 1, "known_hosts": "known_hosts"}
    code, err = _run(stage.write({}, surgeon=ssh, patient={"folder": "/proc"}))
    assert code == 3
    assert "surgeon: 127.0.0.1 port 1: cannot be reached: " in err
    assert "patient: this machine: /proc: cannot be written" in err


def test_a_host_with_another_version_is_refused(stage: Stage, tmp_path: Path) -> None:
    other = tmp_path / "other.py"
    other.write_text("print('tis 0.0.1, eclipse-zenoh 1.0.0')\n")
    code, err = _run(stage.write({}, patient={"tis": f"{sys.executable} {other}"}))
    assert code == 3
    assert "patient: this machine: must run the same versions as this host: tis " in err
    assert "it has tis 0.0.1, eclipse-zenoh 1.0.0" in err


def test_a_side_that_fails_before_the_run_ends_the_others_and_leaves_no_folder(stage: Stage, tmp_path: Path) -> None:
    fails = "say('failed', exit_code=3, reasons=['netem: in use'])\nlog()\nsys.exit(3)\n"
    code, err = _run(stage.write({"netem": fails, "surgeon": WAITS, "patient": WAITS}))
    assert code == 3
    assert "tis: netem: in use" in err
    assert stage.nobody_is_left()
    assert not (tmp_path / "run").exists()
    assert list((tmp_path / "work" / "runs").iterdir()) == []


def test_ctrl_c_ends_every_side_by_sigint_and_the_logs_are_collected(stage: Stage, tmp_path: Path) -> None:
    process = _start(stage.write(dict.fromkeys(SIDES, RUNS + WAITS)))
    logs = tmp_path / "work" / "runs"
    assert soon(lambda: len(list(logs.glob("*/*.mcap"))) == 3)
    process.send_signal(signal.SIGINT)
    err = process.communicate(timeout=60)[1]
    assert "tis: interrupted" in err
    assert stage.nobody_is_left()
    assert {path.name for path in (tmp_path / "run").glob("*.mcap")} == {f"{side}.mcap" for side in SIDES}


def test_a_frozen_side_is_killed_after_a_while(stage: Stage) -> None:
    programs = dict.fromkeys(SIDES, RUNS + WAITS) | {"patient": RUNS + "os.kill(os.getpid(), signal.SIGSTOP)\n"}
    process = _start(stage.write(programs))
    assert soon(lambda: len(stage.pids("patient")) == 1)
    pid = stage.pids("patient")[0]
    assert soon(lambda: "T (stopped)" in Path(f"/proc/{pid}/status").read_text())
    process.send_signal(signal.SIGINT)
    process.communicate(timeout=60)
    assert stage.nobody_is_left()


def test_no_side_outlives_a_killed_tis_up(stage: Stage) -> None:
    process = _start(stage.write(dict.fromkeys(SIDES, RUNS + WAITS)))
    assert soon(lambda: all(stage.pids(side) for side in SIDES))
    process.kill()
    process.communicate(timeout=60)
    assert soon(stage.nobody_is_left)


def test_a_side_that_dies_is_started_again_where_the_file_allows_it(stage: Stage, tmp_path: Path) -> None:
    """The surgeon dies twice, the patient once; only the surgeon may come again, in the same folder."""
    dies = "say('running', duration_s=5.0)\nif n_starts < 3:\n    log('x')\n    os.kill(os.getpid(), 9)\n"
    again = dies + "log('second', f'surgeon_{n_starts}.mcap')\ntime.sleep(1)\n"
    programs = {"surgeon": again, "patient": dies, "netem": "time.sleep(0.3)\n" + RUNS + "time.sleep(4)\n"}
    _, err = _run(stage.write(programs, surgeon={"restart": True}), "--no-report", "--no-merge")
    assert "surgeon (this machine): died, started again (2)" in err
    assert len(stage.pids("surgeon")) == 3
    assert len(stage.pids("patient")) == 1
    assert "patient: killed by SIGKILL" in err
    assert (tmp_path / "run" / "surgeon.mcap").read_text() == "x"
    assert (tmp_path / "run" / "surgeon_3.mcap").read_text() == "second"


def test_a_dead_side_ends_the_others_where_the_scenario_says_so(stage: Stage) -> None:
    programs = dict.fromkeys(SIDES, RUNS + WAITS) | {"patient": RUNS + "time.sleep(1)\nos.kill(os.getpid(), 9)\n"}
    _, err = _run(stage.write(programs, SCENARIO + "on_peer_loss: end\n"), "--no-report", "--no-merge")
    assert "tis: patient: killed by SIGKILL" in err
    assert "interrupted" not in err.partition("tis: ")[2]
    assert stage.nobody_is_left()


def test_a_side_is_not_started_again_for_ever(stage: Stage) -> None:
    dies = "say('running', duration_s=5.0)\nlog('x')\nos.kill(os.getpid(), 9)\n"
    programs = {"surgeon": dies, "patient": RUNS, "netem": RUNS + "time.sleep(6)\n"}
    _run(stage.write(programs, surgeon={"restart": True}), "--no-report", "--no-merge")
    assert len(stage.pids("surgeon")) == 6


def test_what_a_side_prints_instead_of_events_is_shown(stage: Stage) -> None:
    fails = "print('[red]x', file=sys.stderr)\nsys.exit(70)\n"
    code, err = _run(stage.write({"patient": fails, "surgeon": WAITS, "netem": WAITS}))
    assert code == 70
    assert "patient: [red]x" in err
    assert "tis: [red]x" in err
