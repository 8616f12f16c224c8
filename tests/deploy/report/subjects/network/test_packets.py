"""The columns of a link, from records written by hand."""

from pathlib import Path

from tests.deploy.report.hand_made import ARM, COMMAND, ESTIMATED, crossing, fate, release, write_run
from tis.deploy.report.subjects.network.key_figures import link_columns


def test_delays_are_decided_and_realised_and_the_lost_are_apart(tmp_path: Path) -> None:
    netem = [
        fate(COMMAND, 1, 40, 5),
        release(COMMAND, 1, 40, 45, 52.5),  # drawn 5 ms, left after 12.5
        fate(COMMAND, 0, 10, 30),
        release(COMMAND, 0, 10, 40, 40.25),
        fate(COMMAND, 2, 70, None, "loss"),
        fate(COMMAND, 3, 100, None, "outage"),
        fate(COMMAND, 4, 60, 20),
        release(COMMAND, 4, 60, 80, 80, departure="late"),  # overtaken: dropped when it was due
        fate(COMMAND, 5, 130, 20),  # still under way at the end
        fate(COMMAND, 6, 140, 1, foreign=True),
        release(COMMAND, 6, 140, 141, 141, foreign=True),
        *crossing(ESTIMATED, 0, 20, "feedback"),
    ]
    logs = write_run(tmp_path, netem=netem)
    command, feedback = link_columns(logs, "forward"), link_columns(logs, "feedback")
    assert command.sent_s.tolist() == [0.010, 0.040]
    assert command.seq.tolist() == [0, 1]
    assert command.decided_ms.tolist() == [30, 5]
    assert command.realised_ms.tolist() == [30.25, 12.5]
    assert command.lost_s.tolist() == [0.060, 0.070, 0.100]
    assert command.run_lengths.tolist() == [3]  # in the order of offering, 1 0 2 3 4 5, of 2 to 4
    assert command.error_us.tolist() == [7500, 250]
    assert feedback.realised_ms.tolist() == feedback.decided_ms.tolist() == [10]
    assert not len(feedback.lost_s)


def test_keys_stay_apart_and_a_copy_counts_when_it_leaves(tmp_path: Path) -> None:
    netem = [
        fate(ARM, 0, 10, 5),
        release(ARM, 0, 10, 15, 15),
        fate(COMMAND, 0, 10, 7, copies=1),
        release(COMMAND, 0, 10, 0, 11, departure="codel"),
        release(COMMAND, 0, 10, 19, 19.5, copy_index=1),
    ]
    link = link_columns(write_run(tmp_path, netem=netem), "forward")
    assert link.realised_ms.tolist() == [5, 9.5]
    assert link.run_lengths.tolist() == []
    assert link.error_us.tolist() == [0, 500]


def test_without_a_log_there_are_no_columns(tmp_path: Path) -> None:
    link = link_columns(write_run(tmp_path), "forward")
    assert len(link.realised_ms) == 0
