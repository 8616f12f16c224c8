"""Price and gain of redundancy: a few packets worked by hand, and the size of a packet from payloads as they fly."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec.structs import asdict, replace

from tests.deploy.report.hand_made import ARM, COMMAND, a_scenario, counter, message, tick, write_run
from tests.nodes import a_pose
from tis.common.channels import Arm, Hand
from tis.common.messages import HEADER_BYTES, SampledPose, encode
from tis.common.records import SENT_BYTES, SENT_PACKETS
from tis.common.scenario.surgeon import MAX_COPY_DELAY_MS
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.redundancy import alone_bytes, redundancy, redundancy_table, surgeon_traffic
from tis.patient_side.horizon import HORIZON_S

ARMS: dict[Hand, Arm] = {"left": "PSM2"}


def test_a_run_by_hand(tmp_path: Path) -> None:
    """Three samples, twice each on two keys, with the one before; ticks at 30, 60 and 90 ms.

    The command's numbers 0 to 5 are of the samples 0, 0, 1, 1, 2, 2 (at 0, 20, 40 ms). There arrive 1 (the copy of
    the first, at 50 ms) and 5 (that of the last, at 85 ms, with the middle one). Of the arm only the first packet of
    the first sample arrives, at 25 ms, and 4, the first of the last one, at 95 ms.
    """
    sample_ms = (0, 0, 20, 20, 40, 40)
    sent = [
        message(key, seq, ms + seq % 2, sample_ms=ms) for key in (COMMAND, ARM) for seq, ms in enumerate(sample_ms)
    ]
    counters = [counter(f"{name}.{key}", n) for key in (COMMAND, ARM) for name, n in _TRAFFIC]
    logs = write_run(
        tmp_path,
        surgeon=[*sent, *counters, *(tick(k, 20 * k, 20 * k) for k in range(3))],
        patient=[
            message(ARM, 0, 0, log_ms=25, sample_ms=0),
            message(COMMAND, 1, 1, log_ms=50, sample_ms=0),
            message(COMMAND, 5, 41, log_ms=85, sample_ms=40),
            message(ARM, 4, 40, log_ms=95, sample_ms=40),
            *(tick(k, ms, ms) for k, ms in enumerate((30, 60, 90, 120))),
        ],
    )
    scenario = a_scenario(surgeon={"copies": 2, "copy_spacing_ms": 1, "history": 1})
    found = redundancy(logs, scenario, ARMS, surgeon_traffic(logs, 0.5))
    assert (found["copies"], found["copy_spacing_ms"], found["history"]) == (2, 1, 1)
    # of 12 packets 4 arrived; of the arm's samples the middle one rides with the last
    assert found["lost"]["packets_pct"] == pytest.approx(100 * 8 / 12)
    assert (found["lost"]["packets"], found["lost"]["samples"], found["lost"]["samples_pct"]) == (12, 6, 0)
    # first packets alone: the arm's of samples 0 and 2
    assert found["lost"]["samples_once_pct"] == pytest.approx(100 * 4 / 6)
    # freshest at 30, 60, 90, 120 ms: of samples 0, 0, 2, 2, and by first packets alone 0, 0, 0, 2
    assert found["age_ms"]["mean"] == pytest.approx((30 + 60 + 50 + 80) / 4)
    assert found["age_once_ms"]["mean"] == pytest.approx((30 + 60 + 90 + 80) / 4)
    price = found["price"]
    assert (price["packets_per_s"], price["packets_per_s_once"]) == (24, 12)
    assert price["bytes_per_s"] == 2 * 2 * 3000
    assert found.loss_text == "every sample arrived"


_TRAFFIC = ((SENT_PACKETS, 6), (SENT_BYTES, 3000))


def test_of_missing_logs_nothing_is_known_but_what_was_asked_for(tmp_path: Path) -> None:
    found = redundancy(load_run(tmp_path), a_scenario(surgeon={"copies": 3}), {}, {})
    assert found["copies"] == 3
    assert {value for _, value in (*found.price, *found.lost)} == {None}
    assert found["age_ms"]["mean"] is found["age_once_ms"]["mean"] is None
    assert found.loss_text is None
    assert len(redundancy_table(found).rows) == 6


def test_who_sends_once_has_no_rows(tmp_path: Path) -> None:
    found = redundancy(load_run(tmp_path), a_scenario(surgeon={"copy_spacing_ms": 8}), {}, {})
    assert not found.is_used
    assert not redundancy_table(found).rows
    assert str(found) == "each sample once"


@settings(max_examples=25)
@given(n=st.integers(1, 12), history=st.integers(0, 6), copies=st.integers(1, 3))
def test_the_size_of_a_packet_alone_is_that_of_its_pose_as_it_flies(n: int, history: int, copies: int) -> None:
    poses = [replace(a_pose(), sample_ns=10**9 + k) for k in range(n)]
    sizes = [
        len(encode(SampledPose(**asdict(pose), history=tuple(poses[max(0, k - history) : k])))) + HEADER_BYTES
        for k, pose in enumerate(poses)
    ] * copies
    alone = len(encode(poses[0])) + HEADER_BYTES
    assert alone_bytes(sum(sizes) / len(sizes), n, history) == pytest.approx(alone)


def test_a_last_copy_leaves_within_what_the_patient_forecasts() -> None:
    assert MAX_COPY_DELAY_MS == 1000 * HORIZON_S
