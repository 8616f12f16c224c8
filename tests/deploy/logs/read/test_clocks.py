import json
from pathlib import Path

import numpy as np
import pytest

from tests.common.clocks.wrong_clock import S
from tests.deploy.report.hand_made import MS, message, tick, write_log
from tis.common import records
from tis.common.channels import Side
from tis.common.errors import DataError
from tis.common.host_records import CLOCK, DISCIPLINE, EXCHANGES, ClockNote, DisciplineNote, ExchangeNote
from tis.common.node import Record
from tis.deploy.logs.read.clocks import RunClocks, run_clocks, sender_of
from tis.deploy.logs.read.load import aligned, load_run

RTT_NS = 40_000


def compared(boot: str = "s", shared: bool = False, epoch_ns: int = 0) -> Record:
    note = ClockNote(boot_id=boot, reference_boot_id="n", shared=shared, epoch_ns=epoch_ns, reference_epoch_ns=10 * S)
    return Record(CLOCK, 0, note)


def asked(at_ms: float, ahead_ms: float, longer_ms: float = 0) -> Record:
    """An exchange whose ways are 20 us each, the way back longer, with a reference that is ahead."""
    at_ns, ahead_ns = round(at_ms * MS), round(ahead_ms * MS)
    received_ns, answered_ns = at_ns + RTT_NS // 2 + ahead_ns, at_ns + RTT_NS + round(longer_ms * MS)
    note = ExchangeNote(asked_ns=at_ns, received_ns=received_ns, replied_ns=received_ns, answered_ns=answered_ns)
    return Record(EXCHANGES, max(0, at_ns), note)


def test_every_stamp_of_a_side_is_converted_by_the_clock_that_made_it(tmp_path: Path) -> None:
    """The surgeon's clock is 2 ms behind, the patient's 5 ms ahead: a message takes 10 ms, not 17."""
    key = "tis/MTML/measured_cp"
    write_log(tmp_path, "surgeon", [compared("s"), asked(0, 2), asked(100, 2), message(key, 0, 8, sample_ms=7)])
    write_log(tmp_path, "netem", [])
    write_log(
        tmp_path, "patient",
        [compared("p"), asked(0, -5), asked(100, -5), message(key, 0, 8, 25, sample_ms=7), tick(1, 30, 31)],
    )  # fmt: skip
    logs = load_run(tmp_path)
    sent, came = (logs.sides[side].messages[key] for side in ("surgeon", "patient"))
    assert sent.sent_ns.tolist() == sent.log_ns.tolist() == came.sent_ns.tolist() == [10 * MS]
    assert sent.sample_ns.tolist() == came.sample_ns.tolist() == [9 * MS]
    assert came.log_ns.tolist() == [20 * MS]
    [row] = logs.of("patient", records.TICKS)
    assert (row["due_ns"], row["begin_ns"]) == (25 * MS, 26 * MS)
    [open_ns] = logs.clocks.uncertainty_ns("surgeon", sent.sent_ns, "patient", came.log_ns)  # type: ignore[misc]
    assert RTT_NS <= open_ns < RTT_NS + 20_000  # half of either round trip, and what 100 ms of drift can do


def test_the_summary_says_how_each_clock_was_compared(tmp_path: Path) -> None:
    """The monotonic clocks differ by 7 s, which the epochs know, and by 2 ms, which only the exchanges do."""
    said = DisciplineNote(at_ns=0, synchronised=True, estimated_error_us=3, maximum_error_us=9, frequency_ppm=-1.5)
    surgeon = [compared("s", epoch_ns=3 * S), Record(DISCIPLINE, 0, said), *(asked(i * 1000, 2) for i in range(31))]
    write_log(tmp_path, "surgeon", [*surgeon, message("tis/MTML/measured_cp", 0, 30_000)])
    write_log(tmp_path, "netem", [])
    write_log(tmp_path, "patient", [compared("n", shared=True)])
    summary = load_run(tmp_path).clocks.summary()
    clock = summary["surgeon"]
    assert clock["kind"] == "exchanged"
    assert clock["offset_ms"] == pytest.approx(7002)
    assert clock["drift_ppm"] == pytest.approx(0, abs=1e-9)
    assert 0 < clock["drift_uncertainty_ppm"] < 3
    assert 20 <= clock["uncertainty_us"] < 40
    assert clock["n_exchanges"] == 31
    assert clock["min_round_trip_us"] == 40
    assert clock["discipline"] == {
        "synchronised": True, "estimated_error_us": 3, "maximum_error_us": 9, "frequency_ppm": -1.5,
    }  # fmt: skip
    assert summary["netem"]["kind"] == "reference"
    exact = {"offset_ms": 0, "drift_ppm": 0, "uncertainty_us": 0, "n_exchanges": 0, "min_round_trip_us": None}
    for side, kind in (("netem", "reference"), ("patient", "shared")):
        assert summary[side] == {"kind": kind, "drift_uncertainty_ppm": 0, "discipline": None, **exact} | (
            {"offset_ms": 10_000} if kind == "shared" else {}
        )


def test_a_shared_clock_is_exact_and_leaves_the_stamps_alone(tmp_path: Path) -> None:
    write_log(tmp_path, "surgeon", [compared("n", shared=True)])
    write_log(tmp_path, "netem", [])
    write_log(tmp_path, "patient", [compared("n", shared=True), message("tis/MTML/measured_cp", 0, 1, 11)])
    logs = load_run(tmp_path)
    ns = np.array([0, S])
    assert logs.clocks.all_shared
    assert logs.clocks.all_known
    assert logs.clocks.uncertainty_ns("surgeon", ns, "patient", ns).tolist() == [0, 0]  # type: ignore[union-attr]
    assert aligned(logs).sides == logs.sides


def test_two_sides_on_one_host_differ_exactly_however_far_netem_is(tmp_path: Path) -> None:
    """Their exchanges count together: one asked early and the other late, which alone knows no drift."""
    surgeon = [compared("same", epoch_ns=4 * S), asked(0, 2)]
    patient = [compared("same", epoch_ns=5 * S), asked(59_000, 1002)]
    for side, log in (("surgeon", surgeon), ("netem", []), ("patient", patient)):
        write_log(tmp_path, side, log)  # type: ignore[arg-type]
    clocks = load_run(tmp_path).clocks
    assert clocks.summary()["surgeon"]["n_exchanges"] == clocks.summary()["patient"]["n_exchanges"] == 2
    ns = np.array([0, 30 * S])
    assert clocks.uncertainty_ns("surgeon", ns, "patient", ns).tolist() == [0, 0]  # type: ignore[union-attr]
    open_ns = clocks.uncertainty_ns("surgeon", ns, "netem", ns)
    assert open_ns is not None
    assert open_ns.min() > 0
    there = clocks.model("surgeon").to_reference_ns(ns + S)
    assert np.array_equal(clocks.model("patient").to_reference_ns(ns), there)


@pytest.mark.parametrize("log", [[], [compared("s")]], ids=["an old log", "no exchange came through"])
def test_a_clock_that_was_never_compared_is_not_guessed(tmp_path: Path, log: list[Record]) -> None:
    write_log(tmp_path, "surgeon", log)
    write_log(tmp_path, "patient", [compared("n", shared=True)])
    clocks = load_run(tmp_path).clocks
    assert not clocks.all_known
    entry = clocks.summary()["surgeon"]
    assert entry["kind"] == "unknown"
    assert {entry[name] for name in ("offset_ms", "drift_ppm", "uncertainty_us")} == {None}
    ns = np.zeros(1, dtype=np.int64)
    assert clocks.uncertainty_ns("surgeon", ns, "patient", ns) is None
    assert clocks.uncertainty_ns("patient", ns, "netem", ns) is not None


def test_a_clock_of_another_version_is_said_to_be_one() -> None:
    with pytest.raises(DataError, match="/tis/clock: holds records that this version does not know"):
        run_clocks({"surgeon": {CLOCK: [{"boot_id": "s"}]}}, {"surgeon": 0}, "live")


def test_the_hosts_are_those_of_the_clocks_with_what_their_kernels_said(tmp_path: Path) -> None:
    kept = DisciplineNote(at_ns=5, synchronised=True, estimated_error_us=3, maximum_error_us=40, frequency_ppm=-11.5)
    write_log(tmp_path, "surgeon", [compared("far"), asked(0, 2), Record(DISCIPLINE, 5, kept)])
    write_log(tmp_path, "netem", [])
    hosts = load_run(tmp_path).clocks.hosts()
    told = {"synchronised": True, "estimated_error_us": 3, "maximum_error_us": 40, "frequency_ppm": -11.5}
    assert hosts["surgeon"] == {"boot_id": "far", "discipline": told}
    assert hosts["netem"]["discipline"] is None
    json.dumps(hosts)


def test_virtual_time_has_one_clock() -> None:
    sides: list[Side] = ["surgeon", "netem", "patient"]
    assert run_clocks({side: {} for side in sides}, dict.fromkeys(sides, 0), "twin") == RunClocks()


def test_what_is_limited_to_some_topics_is_aligned_all_the_same(tmp_path: Path) -> None:
    write_log(tmp_path, "patient", [compared("p"), asked(0, 7), tick(0, 3, 4)])
    [row] = load_run(tmp_path, wanted=(records.TICKS,)).of("patient", records.TICKS)
    assert (row["due_ns"], row["begin_ns"]) == (10 * MS, 11 * MS)


def test_who_stamps_which_key() -> None:
    assert sender_of("tis/MTML/measured_cp") == sender_of("a/b/PSM2/setpoint_cp") == "surgeon"
    assert sender_of("tis/PSM2/measured_cp") == sender_of("tis/PSM1/estimated_cp") == "patient"
    assert sender_of("elsewhere/topic") is None
    assert sender_of("x") is None
