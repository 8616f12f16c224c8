"""How a run is judged by the ends of its three processes; small programs stand in for the sides."""

import os
import socket
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.deploy.report.hand_made import a_scenario
from tis.common.runtime.ports import free_endpoints
from tis.common.scenario import Scenario
from tis.deploy.shell import launch as launch_module
from tis.deploy.shell.launch import launch
from tis.deploy.shell.outcome import Outcome

pytestmark = pytest.mark.live
FAILED = "import json; print(json.dumps(dict(side='{side}', event='failed', exit_code={code}, reasons={reasons})))\n"


class Stage:
    """A folder of programs that are started in place of the sides."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self.events: list[dict[str, Any]] = []
        self.on_event: Callable[[dict[str, Any]], None] = self.events.append

    def play(self, scenario: Scenario | None = None, **programs: str) -> Outcome:
        for side in ("surgeon", "netem", "patient"):
            head = (
                f"import os, pathlib\npathlib.Path({str(self.path)!r}, '{side}.pid').write_text(str(os.getpid()))\n"
            )
            (self.path / f"stand_in_{side}.py").write_text(head + programs.get(side, ""))
        return launch(scenario or a_scenario(), self.path, self.on_event)

    def nobody_is_left(self) -> bool:
        pids = [int(path.read_text()) for path in self.path.glob("*.pid")]
        return len(pids) == 3 and not any(Path(f"/proc/{pid}").exists() for pid in pids)


@pytest.fixture
def stage(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Stage:
    modules = {side: f"stand_in_{side}" for side in ("surgeon", "netem", "patient")}
    monkeypatch.setattr(launch_module, "MODULES", modules)
    monkeypatch.setenv("PYTHONPATH", f"{tmp_path}{os.pathsep}{os.environ.get('PYTHONPATH', '')}")
    return Stage(tmp_path)


def _fails(side: str, code: int, *reasons: str) -> str:
    return FAILED.format(side=side, code=code, reasons=list(reasons)) + f"raise SystemExit({code})\n"


def test_three_good_ends_are_a_good_run_and_every_event_is_passed_on(stage: Stage) -> None:
    event = 'print(\'{"side": "patient", "event": "ready"}\', flush=True)\n'
    assert stage.play(patient=event * 3) == Outcome(0, (), {"surgeon": 0, "netem": 0, "patient": 0})
    assert stage.events == [{"side": "patient", "event": "ready"}] * 3
    assert stage.nobody_is_left()


def test_the_side_that_failed_for_a_reason_of_its_own_names_the_run(stage: Stage) -> None:
    """The others only lost a peer (3); what they say of it comes after, and each reason once."""
    outcome = stage.play(
        surgeon=_fails("surgeon", 3, "surgeon: patient left during the run", "shared"),
        netem=_fails("netem", 3, "netem: patient left during the run", "shared"),
        patient=_fails("patient", 4, "patient: log: No space left on device"),
    )
    assert outcome.exit_code == 4
    assert sorted(outcome.reasons) == [
        "netem: patient left during the run",
        "patient: log: No space left on device",
        "shared",
        "surgeon: patient left during the run",
    ]
    assert outcome.exit_codes == {"surgeon": 3, "netem": 3, "patient": 4}


def test_a_killed_side_comes_first_with_its_last_words(stage: Stage) -> None:
    kill = "import os, sys\nprint('out of', 'memory?', file=sys.stderr, flush=True)\nos.kill(os.getpid(), 9)\n"
    outcome = stage.play(netem=kill, patient=_fails("patient", 3, "patient: netem left during the run"))
    assert outcome.exit_code == 3
    assert outcome.reasons == (
        "netem: killed by SIGKILL, last output: out of memory?",
        "patient: netem left during the run",
    )


def test_a_side_that_dies_without_a_word_is_a_failure_all_the_same(stage: Stage) -> None:
    outcome = stage.play(surgeon="raise SystemExit(70)\n")
    assert (outcome.exit_code, outcome.reasons) == (70, ("a side failed without giving a reason",))


def test_a_traceback_is_reported_by_its_end(stage: Stage) -> None:
    outcome = stage.play(surgeon="raise RuntimeError('the very reason')\n")
    assert outcome.exit_code == 1
    assert outcome.reasons[-1] == "RuntimeError: the very reason"


@pytest.mark.parametrize("line", ["hello", "42", "[1]", "null", "{}", '{"event": 1'])
def test_a_line_that_is_no_event_is_no_event(stage: Stage, line: str) -> None:
    outcome = stage.play(surgeon=f"print({line!r})\nraise SystemExit(70)\n")
    assert outcome.reasons == (line,)
    assert stage.events == []


def test_sides_that_hang_after_a_failure_are_ended_and_not_blamed(stage: Stage) -> None:
    """One listens to SIGTERM, one does not: it is killed."""
    deaf = "import signal, time\nsignal.signal(signal.SIGTERM, signal.SIG_IGN)\ntime.sleep(30)\n"
    begun_s = time.monotonic()
    outcome = stage.play(
        surgeon="import time\ntime.sleep(30)\n",
        netem=deaf,
        patient="import time\ntime.sleep(0.3)\n" + _fails("patient", 4, "patient: log: full"),
    )
    assert time.monotonic() - begun_s < 15
    assert (outcome.exit_code, outcome.reasons) == (4, ("patient: log: full",))
    assert outcome.exit_codes == {"surgeon": -15, "netem": -9, "patient": 4}
    assert stage.nobody_is_left()


def test_a_scenario_that_goes_on_without_a_peer_is_not_ended(stage: Stage) -> None:
    outcome = stage.play(
        a_scenario(on_peer_loss="continue"),
        surgeon=_fails("surgeon", 4, "surgeon: log: full"),
        patient="import time\ntime.sleep(1.6)\n",  # beyond the time after which a failed run is ended
    )
    assert outcome.exit_codes == {"surgeon": 4, "netem": 0, "patient": 0}
    assert (outcome.exit_code, outcome.reasons) == (4, ("surgeon: log: full",))


def test_an_error_while_watching_leaves_no_child_behind(stage: Stage) -> None:
    def fail(event: dict[str, Any]) -> None:
        raise RuntimeError("the display broke")

    stage.on_event = fail
    sleep = "import time\ntime.sleep(30)\n"
    speak = 'print(\'{"side": "netem", "event": "ready"}\', flush=True)\n'
    with pytest.raises(RuntimeError, match="the display broke"):
        stage.play(surgeon=sleep, netem="import time\ntime.sleep(0.5)\n" + speak + sleep, patient=sleep)
    assert stage.nobody_is_left()


def test_free_endpoints_are_two_and_can_be_had() -> None:
    west, east = free_endpoints()
    assert west != east
    for endpoint in (west, east):
        host, port = endpoint.removeprefix("tcp/").split(":")
        with socket.create_server((host, int(port))):
            pass
