"""The columns of a link, from records written by hand."""

from pathlib import Path

from deploy.report.packets import link_columns
from tests.deploy.report.hand_made import COMMAND, ESTIMATED, crossing, fate, release, write_run


def test_delays_are_decided_and_realised_and_the_lost_are_apart(tmp_path: Path) -> None:
    netem = [
        fate(COMMAND, 1, 40, 5),
        release(COMMAND, 1, 40, 45, 52.5),  # drawn 5 ms, left after 12.5
        fate(COMMAND, 0, 10, 30),
        release(COMMAND, 0, 10, 40, 40.25),
        fate(COMMAND, 2, 70, None, "loss"),
        fate(COMMAND, 3, 100, None, "outage"),
        fate(COMMAND, 4, 60, 20),
        release(COMMAND, 4, 60, 80, 80, late=True),  # overtaken: dropped when it was due
        fate(COMMAND, 5, 130, 20),  # still under way at the end
        fate(COMMAND, 6, 140, 1, foreign=True),
        release(COMMAND, 6, 140, 141, 141, foreign=True),
        *crossing(ESTIMATED, 0, 20, "feedback"),
    ]
    logs = write_run(tmp_path, netem=netem)
    forward, feedback = link_columns(logs, "forward"), link_columns(logs, "feedback")
    assert forward.sent_s.tolist() == [0.010, 0.040]
    assert forward.seq.tolist() == [0, 1]
    assert forward.decided_ms.tolist() == [30, 5]
    assert forward.realised_ms.tolist() == [30.25, 12.5]
    assert forward.lost_s.tolist() == [0.060, 0.070, 0.100]
    assert feedback.realised_ms.tolist() == feedback.decided_ms.tolist() == [10]
    assert not len(feedback.lost_s)


def test_without_a_log_there_are_no_columns(tmp_path: Path) -> None:
    columns = link_columns(write_run(tmp_path), "forward")
    assert len(columns.sent_s) == len(columns.seq) == len(columns.realised_ms) == len(columns.lost_s) == 0
