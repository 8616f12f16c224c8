"""``patient.tick`` with real processes: the modes work on a wall clock, and a replay makes the same decisions."""

import pytest

from tests.system.conftest import StartHere, is_right_but_for_the_machine
from tis.common.records import PHASES, PROMPT, TICKS
from tis.deploy.logs.read.load import load_run
from tis.deploy.run.replay import replay

pytestmark = pytest.mark.live

ESTIMATORS = ("estimators=[hold, innovations_kf]", "active_estimator=innovations_kf")


@pytest.mark.parametrize("mode", ["phase_locked", pytest.param("on_arrival", marks=pytest.mark.slow)])
def test_a_live_run_replays_bit_for_bit(mode: str, run_here: StartHere) -> None:
    words = (f"patient.tick={mode}", "network.forward.jitter=null", *ESTIMATORS)
    tis = run_here(
        "run", "default", "-v", "--duration-s", "2.5", *(word for text in words for word in ("--set", text))
    )
    code, out, err = tis.wait()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), (err, summary["problems"])
    assert f"Ticks: {mode}" in out
    found = replay(tis.run_dir)
    assert found.identical
    logs = load_run(tis.run_dir)
    n_prompt, shifts = len(logs.of("patient", PROMPT)), list(logs.of("patient", PHASES))
    n_ticks = sum(not row["missed"] for row in logs.of("patient", TICKS))
    assert found.n_compared == (2 + 2) * n_ticks + n_prompt + len(logs.of("patient", "tis/PSM2/servo_cp"))
    assert summary["latency_ms"]["end_to_end"]["p50"] >= 40
    if mode == "on_arrival":
        assert n_prompt > 40
        assert shifts == []
        sent = logs.messages("patient", "feedback", "tis")["tis/PSM2/estimated_cp"]
        assert sent.seq.tolist() == list(range(len(sent)))
    else:
        assert n_prompt == 0
        assert shifts or summary["problems"]  # arrivals that a busy machine scatters have no phase that is better
        assert all(0 <= shift["phase_ns"] < 33_333_334 for shift in shifts)
