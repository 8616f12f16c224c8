"""One link's books, from three logs of a few packets each."""

from pathlib import Path

import pytest

from deploy.report.links import link_summary
from deploy.report.load import load_run
from tests.deploy.report.hand_made import ARM, COMMAND, crossing, fate, message, release, write_log, write_run


def test_every_packet_is_found_again_in_exactly_one_place(tmp_path: Path) -> None:
    """Eight commands: 0 arrives twice, 1 lost, 2 after 3, 4 still under way, 5 overtaken, 6 and 7 unplanned."""
    logs = write_run(
        tmp_path,
        surgeon=[message(COMMAND, k, sent_ms=10 * k) for k in range(8)],
        netem=[
            fate(COMMAND, 0, 1, 20),
            fate(COMMAND, 1, 11, None, "loss"),
            fate(COMMAND, 2, 21, 40),
            fate(COMMAND, 3, 31, 20),
            fate(COMMAND, 4, 41, 30),
            fate(COMMAND, 5, 51, 30),
            # 6 is lost before netem
            fate(COMMAND, 7, 71, 20),
            release(COMMAND, 0, 1, 21, 21.1),
            release(COMMAND, 3, 31, 51, 51.3),
            release(COMMAND, 2, 21, 61, 61.2),
            release(COMMAND, 5, 51, 81, 81, late=True),
            release(COMMAND, 7, 71, 91, 91.4),  # and is lost behind netem
        ],
        patient=[
            message(COMMAND, 0, 0, log_ms=22),
            message(COMMAND, 0, 0, log_ms=23),
            message(COMMAND, 3, 30, log_ms=52),
            message(COMMAND, 2, 20, log_ms=62),
        ],
    )
    link, problems = link_summary(logs, "forward", "tis")
    assert problems == []
    assert {name: link[name] for name in ("sent", "offered", "released", "dropped", "held_at_end", "received")} == {
        "sent": 8,
        "offered": 7,  # all but 6
        "released": 4,  # 0, 3, 2, 7
        "dropped": 2,  # 1, 5
        "held_at_end": 1,  # 4
        "received": 3,  # 0, 3, 2
    }
    assert link["offered"] == link["released"] + link["dropped"] + link["held_at_end"]
    assert link["unplanned_loss"] == (8 - 7) + (4 - 3)
    assert (link["duplicated"], link["reordered"], link["foreign"]) == (1, 1, 0)
    assert link["dropped_by"] == {"loss": 1, "late": 1}
    assert link["loss_pct"] == 100 * 2 / 7
    low, high = link["loss_pct_interval_95"]
    assert 0 < low < 100 * 2 / 7 < high < 100

    # decided: 20 40 20 30 30 20 for 0 2 3 4 5 7, in whatever way they ended afterwards
    decided = link["delay_ms"]["decided"]
    assert decided["mean"] == pytest.approx(160 / 6)
    assert (decided["p50"], decided["max"]) == (20, 40)
    # realised: 0: 20.1, 3: 20.3, 2: 40.2, 7: 20.4, and the overtaken 5 never left
    realised = link["delay_ms"]["realised"]
    assert realised["mean"] == pytest.approx(101 / 4)
    assert (realised["p50"], realised["max"]) == (20.3, 40.2)
    # left later than due by 100, 300, 200, 400 us
    assert link["release_error_us"] == {"p50": 200, "p95": 400, "p99": 400, "max": 400}


def test_order_counts_within_a_key_and_each_direction_by_itself(tmp_path: Path) -> None:
    """The arm's 1 before the command's 0 is no reordering; the surgeon's own messages are no feedback."""
    sent = [message(key, k, 10 * k) for k in range(2) for key in (COMMAND, ARM)]
    logs = write_run(
        tmp_path,
        surgeon=sent,
        netem=[record for k in range(2) for key in (COMMAND, ARM) for record in crossing(key, k, 10 * k)],
        patient=[
            message(ARM, 0, 0, log_ms=11),
            message(ARM, 1, 10, log_ms=12),
            message(COMMAND, 0, 0, log_ms=13),
            message(COMMAND, 1, 10, log_ms=21),
        ],
    )
    forward, problems = link_summary(logs, "forward", "tis")
    assert problems == []
    assert (forward["sent"], forward["received"], forward["reordered"], forward["duplicated"]) == (4, 4, 0, 0)
    feedback, problems = link_summary(logs, "feedback", "tis")
    assert problems == []
    assert (feedback["sent"], feedback["offered"], feedback["received"]) == (0, 0, 0)
    assert feedback["loss_pct"] is feedback["loss_pct_interval_95"] is None
    assert feedback["delay_ms"]["realised"]["mean"] is feedback["release_error_us"]["p99"] is None


def test_foreign_packets_and_strangers_are_counted_and_kept_out(tmp_path: Path) -> None:
    """A stranger has our attachment but nobody here sent it: somebody else publishes on our key."""
    logs = write_run(
        tmp_path,
        surgeon=[message(COMMAND, 0, 0)],
        netem=[
            *crossing(COMMAND, 0, 0),
            fate(COMMAND, 0, 2, 500, foreign=True),  # numbered by netem: the same name as ours
            release(COMMAND, 0, 2, 502, 600, foreign=True),
            fate("somebody/else", 0, 3, None, "refused", foreign=True),
            *crossing(COMMAND, 4_000_000, 5),
            fate(COMMAND, 4_000_001, 6, None, "loss"),
        ],
        patient=[message(COMMAND, 0, 0, log_ms=11), message(COMMAND, 4_000_000, 5, log_ms=16)],
    )
    link, problems = link_summary(logs, "forward", "tis")
    assert problems == []
    assert link["foreign"] == 4
    assert (link["sent"], link["offered"], link["released"], link["received"]) == (1, 1, 1, 1)
    assert (link["dropped"], link["dropped_by"], link["loss_pct"]) == (0, {}, 0)
    assert link["delay_ms"]["decided"]["max"] == link["delay_ms"]["realised"]["max"] == 10
    assert link["release_error_us"]["max"] == 0


def test_what_does_not_add_up_is_listed_with_the_first_packet(tmp_path: Path) -> None:
    logs = write_run(
        tmp_path,
        surgeon=[message(COMMAND, k, 10 * k) for k in range(4)],
        netem=[
            *crossing(COMMAND, 0, 0),
            *crossing(COMMAND, 1, 10),
            fate(COMMAND, 1, 10.5, 10),  # offered twice
            fate(COMMAND, 2, 20, None, "loss"),
            release(COMMAND, 2, 20, 30, 30),  # lost, and released all the same
            release(COMMAND, 3, 30, 40, 40),  # never offered
        ],
        patient=[message(COMMAND, k, 10 * k, log_ms=10 * k + 11) for k in range(3)],
    )
    _, problems = link_summary(logs, "forward", "tis")
    assert problems == [
        "links.forward: 1 packets stand more than once in offered",
        "links.forward: 1 packets: released, dropped or held but never offered; the first is "
        "tis/MTML/measured_cp seq 3",
        "links.forward: 1 packets: more than one of released, dropped and held; the first is "
        "tis/MTML/measured_cp seq 2",
    ]


def test_a_packet_that_came_round_netem_is_listed(tmp_path: Path) -> None:
    logs = write_run(
        tmp_path,
        surgeon=[message(COMMAND, 0, 0), message(COMMAND, 1, 10)],
        netem=[*crossing(COMMAND, 0, 0), fate(COMMAND, 1, 10, None, "loss")],
        patient=[message(COMMAND, 0, 0, log_ms=11), message(COMMAND, 1, 10, log_ms=10.2)],
    )
    _, problems = link_summary(logs, "forward", "tis")
    assert problems == [
        "links.forward: 1 packets: received but never released; the first is tis/MTML/measured_cp seq 1"
    ]


@pytest.mark.parametrize("missing", ["surgeon", "netem", "patient"])
def test_a_missing_log_makes_its_figures_null_and_accuses_nobody(tmp_path: Path, missing: str) -> None:
    write_log(tmp_path, "surgeon", [message(COMMAND, k, 10 * k) for k in range(3)])
    write_log(tmp_path, "netem", [record for k in range(3) for record in crossing(COMMAND, k, 10 * k)])
    write_log(tmp_path, "patient", [message(COMMAND, k, 10 * k, log_ms=10 * k + 11) for k in range(3)])
    (tmp_path / f"{missing}.mcap").unlink()
    link, problems = link_summary(load_run(tmp_path), "forward", "tis")
    assert problems == []
    kept = {
        "surgeon": ("sent",),
        "netem": ("offered", "released", "dropped", "held_at_end", "foreign"),
        "patient": ("received", "duplicated", "reordered"),
    }
    for side, names in kept.items():
        for name in names:
            assert (link[name] is None) == (side == missing), name
    assert link["unplanned_loss"] is None


def test_after_a_damaged_senders_log_nobody_is_taken_for_a_stranger(tmp_path: Path) -> None:
    """The packets that the torn log no longer names were sent all the same."""
    write_log(tmp_path, "surgeon", [message(COMMAND, 0, 0)])
    write_log(tmp_path, "netem", [record for k in range(3) for record in crossing(COMMAND, k, 10 * k)])
    write_log(tmp_path, "patient", [message(COMMAND, k, 10 * k, log_ms=10 * k + 11) for k in range(3)])
    whole = (tmp_path / "surgeon.mcap").read_bytes()
    (tmp_path / "surgeon.mcap").write_bytes(whole[:-20])
    link, problems = link_summary(load_run(tmp_path), "forward", "tis")
    assert (link["foreign"], link["offered"], link["received"]) == (0, 3, 3)
    assert problems == ["links.forward: 2 packets: offered but never sent; the first is tis/MTML/measured_cp seq 1"]
