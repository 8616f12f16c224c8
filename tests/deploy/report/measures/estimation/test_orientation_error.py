from math import pi, radians
from pathlib import Path

import pytest

from common.messages import Vector3
from common.node import Record
from common.records import TRUTH, TruthRow
from deploy.logs.read.load import RunLogs
from deploy.report.measures.estimation.orientation_error import orientation_deg
from deploy.report.measures.estimation.tracking import track_of_hand
from tests.deploy.report.hand_made import ARM, MS, a_scenario, estimate, message, write_run
from tests.patient_side.arm_models import static_model

MODEL = static_model()


def turning(k: int) -> Record:
    """The arm turns by 9 degrees about z each 100 ms, past half a turn too."""
    angle = radians(9 * k) if k <= 20 else radians(9 * k) - 2 * pi
    note = TruthRow(
        hand="left",
        index=k,
        sample_ns=100 * k * MS,
        position_m=Vector3(x=0.001 * k, y=0, z=0),
        rotation_rad=Vector3(x=0, y=0, z=angle),
    )
    return Record(TRUTH, note.sample_ns, note)


def a_run(tmp_path: Path, arrivals: list[Record]) -> RunLogs:
    rows = [estimate(k, 2100 + 100 * k, "hold", (0.02, 0, 0)) for k in range(4)]
    return write_run(tmp_path, surgeon=[turning(k) for k in range(40)], patient=[*arrivals, *rows])


def test_held_for_50_ms_and_for_250_ms_a_turning_arm_is_off_by_as_much_as_it_turned(tmp_path: Path) -> None:
    arrivals = [
        message(ARM, 0, 0, log_ms=50, sample_ms=0),
        message(ARM, 20, 2000, log_ms=2090, sample_ms=2000),
        message(ARM, 21, 2100, log_ms=2150, sample_ms=2100),
        message(ARM, 19, 1900, log_ms=2250, sample_ms=1900),  # late, and older: changes nothing
    ]
    logs = a_run(tmp_path, arrivals)
    found = orientation_deg(logs, a_scenario(), track_of_hand(logs, a_scenario(), "left"), MODEL)
    # ticks at 2100, 2200, 2300, 2400 hold the samples of 2000, 2100, 2100, 2100 ms
    assert found["rms"] == pytest.approx(((9**2 + 9**2 + 18**2 + 27**2) / 4) ** 0.5, abs=1e-6)
    assert found["max"] == pytest.approx(27, abs=1e-6)
    assert found["p50"] == pytest.approx(9, abs=1e-6)


def test_without_the_arms_stream_or_its_orientations_nothing_is_known(tmp_path: Path) -> None:
    logs = a_run(tmp_path, [])
    found = orientation_deg(logs, a_scenario(), track_of_hand(logs, a_scenario(), "left"), MODEL)
    assert set(found.values()) == {None}
