"""One link's books, from three logs of a few packets each."""

from pathlib import Path

import pytest

from tests.deploy.report.hand_made import (
    ARM,
    COMMAND,
    MS,
    a_scenario,
    counter,
    crossing,
    cut_log,
    fate,
    message,
    queue,
    rejected,
    release,
    write_log,
    write_run,
)
from tests.deploy.report.partial import causes
from tis.common.node import Record
from tis.common.records import CONTROL, ControlNote
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.network.link_summary import link_summary


def test_what_is_sent_as_netem_ends_is_under_way_and_not_lost(tmp_path: Path) -> None:
    """Ctrl-C ends the sides one after the other; a sender that goes on for a second would tell of a fault."""
    sent_ms = [0, 100, 114, 119, 300, 900]
    logs = write_run(
        tmp_path,
        surgeon=[message(COMMAND, k, sent_ms=at_ms) for k, at_ms in enumerate(sent_ms)],
        netem=[fate(COMMAND, 0, 1, 20), release(COMMAND, 0, 1, 21, 21), fate(COMMAND, 1, 101, 20),
               release(COMMAND, 1, 101, 121, 121)],
        patient=[message(COMMAND, 0, 0, log_ms=22), message(COMMAND, 1, 100, log_ms=122)],
    )  # fmt: skip
    link, _ = link_summary(logs, "forward", a_scenario())
    assert (link["sent"], link["offered"], link["lost_before_netem"]) == (3, 2, 1)  # the last, 0.8 s later


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
            release(COMMAND, 5, 51, 81, 81, departure="late"),
            release(COMMAND, 7, 71, 91, 91.4),  # and is lost behind netem
        ],
        patient=[
            message(COMMAND, 0, 0, log_ms=22),
            message(COMMAND, 0, 0, log_ms=23),
            message(COMMAND, 3, 30, log_ms=52),
            message(COMMAND, 2, 20, log_ms=62),
        ],
    )
    link, problems = link_summary(logs, "forward", a_scenario())
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
    assert (link["duplicated"], link["duplicated_by_netem"]) == (1, 0)
    assert (link["reordered"], link["reordered_in_netem"], link["foreign"]) == (1, 1, 0)
    assert link["reordering_extent"]["max"] == 1  # 2 came one place behind 3
    assert link["n_reordering"]["max"] == 1
    assert link["lost"] == 2
    assert (link["loss_runs"]["count"], link["loss_runs"]["mean"], link["loss_runs"]["longest"]) == (2, 1, 1)
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

    # 20.1, 40.2, 20.3, 20.4 vary by 0, 20.1, 0.2, 0.3 above the smallest; only 2 and 3 are neighbours that both left
    assert link["pdv_ms"]["mean"] == pytest.approx(20.6 / 4)
    assert link["pdv_ms"]["max"] == pytest.approx(20.1)
    assert link["ipdv_ms"]["p50"] == link["ipdv_ms"]["max"] == pytest.approx(19.9)
    # transit times by departure: 20.1, 20.3, 40.2, 20.4: |D| 0.2, 19.9, 19.8
    jitter = 0.2 / 16
    for change in (19.9, 19.8):
        jitter += (change - jitter) / 16
    key = link["keys"][COMMAND]
    assert key["rfc3550_jitter_ms"]["last"] == key["rfc3550_jitter_ms"]["max"] == pytest.approx(jitter)
    assert {**key.as_json(), "foreign": 0}.items() >= {
        name: link[name] for name in ("sent", "lost", "pdv_ms")
    }.items()


def test_copies_and_corruption_have_entries_of_their_own(tmp_path: Path) -> None:
    """0 comes twice by netem. 1's copy is held. 2 is corrupted and refused. 3 arrives twice by itself. 4: its copy
    leaves though the original is dropped from the queue.
    """
    logs = write_run(
        tmp_path,
        surgeon=[message(COMMAND, k, sent_ms=10 * k) for k in range(5)],
        netem=[
            fate(COMMAND, 0, 1, 20, copies=1),
            fate(COMMAND, 1, 11, 20, copies=1),
            fate(COMMAND, 2, 21, 20, flipped=3),
            fate(COMMAND, 3, 31, 20),
            fate(COMMAND, 4, 41, 20, copies=1),
            release(COMMAND, 0, 1, 21, 21.5, queued_ms=3),
            release(COMMAND, 0, 1, 25, 25.1, copy_index=1, queued_ms=4),
            release(COMMAND, 1, 11, 31, 31),
            release(COMMAND, 2, 21, 41, 41),
            release(COMMAND, 3, 31, 51, 51),
            release(COMMAND, 4, 41, 0, 45, departure="codel"),
            release(COMMAND, 4, 41, 61, 61, copy_index=1),
        ],
        patient=[
            *(
                message(COMMAND, seq, 10 * seq, log_ms=ms)
                for seq, ms in ((0, 22), (0, 26), (1, 32), (3, 52), (3, 53), (4, 62))
            ),
            rejected(COMMAND, 42),
        ],
    )
    link, problems = link_summary(logs, "forward", a_scenario())
    assert problems == []
    counts = ("offered", "copied", "released", "dropped", "held_at_end", "lost", "received")
    assert [link[name] for name in counts] == [5, 3, 6, 1, 1, 0, 4]
    assert link["offered"] + link["copied"] == link["released"] + link["dropped"] + link["held_at_end"]
    assert (link["duplicated"], link["duplicated_by_netem"]) == (2, 1)
    assert (link["corrupted"], link["corrupted_rejected"], link["unplanned_loss"]) == (1, 1, 0)
    assert link["dropped_by"] == {"codel": 1}
    assert link["loss_pct"] == 0
    assert link["queued_ms"]["max"] == 4
    assert link["delay_ms"]["realised"]["max"] == 20.5
    assert link["release_error_us"]["max"] == 500


def test_the_delay_of_a_message_is_that_of_its_first_copy_to_leave(tmp_path: Path) -> None:
    """RFC 7679. 0's copy overtakes it, 1 leaves before its copy, of 2 only the copy leaves."""
    netem = [
        fate(COMMAND, 0, 0, 20, copies=1),
        release(COMMAND, 0, 0, 20, 20),
        release(COMMAND, 0, 0, 5, 5, copy_index=1),
        fate(COMMAND, 1, 10, 8, copies=1),
        release(COMMAND, 1, 10, 18, 18),
        release(COMMAND, 1, 10, 30, 30, copy_index=1),
        fate(COMMAND, 2, 20, 9, copies=1),
        release(COMMAND, 2, 20, 0, 29, departure="codel"),
        release(COMMAND, 2, 20, 32, 32, copy_index=1),
        fate(COMMAND, 3, 30, 4),
        release(COMMAND, 3, 30, 34, 34),
    ]
    logs = write_run(tmp_path, [message(COMMAND, k, 10 * k) for k in range(4)], netem)
    link, _ = link_summary(logs, "forward", a_scenario())
    realised = link["delay_ms"]["realised"]
    assert (realised["mean"], realised["max"]) == (pytest.approx((5 + 8 + 12 + 4) / 4), 12)
    # 5 8 12 4: each against the one sent before, and against the smallest
    assert link["ipdv_ms"]["max"] == 8
    assert link["pdv_ms"]["max"] == 8
    jitter = 0.0
    for change in (3, 4, 8):
        jitter += (change - jitter) / 16
    assert link["keys"][COMMAND]["rfc3550_jitter_ms"]["last"] == pytest.approx(jitter)


def test_each_key_has_the_links_figures_of_its_own(tmp_path: Path) -> None:
    """Applications' keys too; what only ends of the testbed could tell of them is None."""
    netem = [
        *crossing(COMMAND, 0, 0),
        fate(COMMAND, 1, 10, None, "loss"),
        *crossing(ARM, 0, 5),
        fate("demo/chat", 0, 7, 30, foreign=True),
        release("demo/chat", 0, 7, 37, 37.2, foreign=True),
        fate("demo/chat", 1, 8, None, "loss", foreign=True),
    ]
    logs = write_run(tmp_path, [message(COMMAND, 0, 0), message(COMMAND, 1, 10), message(ARM, 0, 5)], netem)
    link, _ = link_summary(logs, "forward", a_scenario(network={"unmatched": "pass"}))
    keys = link["keys"]
    assert list(keys) == [COMMAND, ARM, "demo/chat (foreign)"]
    assert link["keys_not_listed"] == 0
    assert [key["loss_pct"] for key in keys.values()] == [50, 0, 50]
    assert link["loss_pct"] == pytest.approx(100 / 3)
    chat = keys["demo/chat (foreign)"]
    assert chat["delay_ms"]["realised"]["max"] == pytest.approx(30.2)
    assert (chat["offered"], chat["released"], chat["lost"]) == (2, 1, 1)
    assert chat["sent"] is chat["received"] is chat["unplanned_loss"] is chat["reordered"] is None
    assert set(dict(chat)) == set(dict(keys[COMMAND]))


def test_what_is_asked_stands_beside_what_was_decided(tmp_path: Path) -> None:
    sent = [message(COMMAND, k, 10 * k) for k in range(3)]
    logs = write_run(tmp_path, sent, [record for k in range(3) for record in crossing(COMMAND, k, 10 * k)])
    pipeline = {
        "delay": {"kind": "uniform", "low_ms": 5, "high_ms": 15},
        "loss": {"kind": "burst", "p_loss": 0.1, "mean_burst": 4},
    }
    link, _ = link_summary(logs, "forward", a_scenario(network={"forward": pipeline}))
    requested = link["delay_ms"]["requested"]
    assert requested["mean"] == pytest.approx(10)
    assert requested["std"] == pytest.approx(10 / 12**0.5)
    assert [requested[p] for p in ("p50", "p90", "p99.9")] == pytest.approx([10, 14, 14.99])
    assert requested["max"] is None
    assert link["requested"]["loss_pct"] == pytest.approx(10)
    assert link["requested"]["mean_burst"] == pytest.approx(4)
    assert (link["requested"]["duplicate_pct"], link["requested"]["varies"]) == (0, False)
    changing = {"forward": pipeline, "timeline": [{"at_s": 1, "for_s": 1, "set": {"outage": True}}]}
    link, _ = link_summary(logs, "forward", a_scenario(network=changing))
    assert link["requested"]["varies"]
    assert link["delay_ms"]["requested"] == requested


def test_keys_that_are_asked_for_different_things_have_nothing_asked_together(tmp_path: Path) -> None:
    sent = [message(COMMAND, 0, 0), message(ARM, 0, 0)]
    logs = write_run(tmp_path, sent, [*crossing(COMMAND, 0, 0), *crossing(ARM, 0, 0)])
    network = {"forward": {"delay": {"kind": "constant", "delay_ms": 10}}}
    link, _ = link_summary(logs, "forward", a_scenario(network=network, topology="observer"))
    assert link["delay_ms"]["requested"]["mean"] is link["requested"]["loss_pct"] is None
    assert link["keys"][COMMAND]["delay_ms"]["requested"]["mean"] == 0
    assert link["keys"][ARM]["delay_ms"]["requested"]["mean"] == 10


def test_queues_and_changes_are_told(tmp_path: Path) -> None:
    """The queue held 4 packets for 10 ms and 0 for 30; an outage of 5 ms, then a step; one request was refused."""
    network = {
        "timeline": [
            {"at_s": 0.010, "for_s": 0.005, "set": {"outage": True}},
            {"at_s": 0.020, "set": {"add_delay_ms": 3}},
        ]
    }
    netem = [
        queue(10, 4, 400),
        queue(20, 0, 0),
        queue(20, 9, 900, direction="feedback"),
        Record(
            CONTROL, 30 * MS, ControlNote(at_ns=30 * MS, applied_ns=0, request="{}", accepted=False, reason="junk")
        ),
        *crossing(COMMAND, 0, 40),
    ]
    link, _ = link_summary(write_run(tmp_path, netem=netem), "forward", a_scenario(network=network))
    assert link["queue"]["packets"]["max"] == 4
    assert link["queue"]["packets"]["mean"] == pytest.approx(4 * 10 / 40)
    assert link["queue"]["bytes"]["max"] == 400
    conditions = link["conditions"]
    assert (conditions["changes"], conditions["outages"], conditions["outage_s"]) == (3, 1, 0.005)
    assert (conditions["control_accepted"], conditions["control_refused"]) == (0, 1)
    assert conditions["states_s"] == {}


def test_a_log_that_contradicts_netems_counters_is_a_problem(tmp_path: Path) -> None:
    netem = [*crossing(COMMAND, 0, 0), counter("forward.offered", 1), counter("forward.released", 2)]
    logs = write_run(tmp_path, [message(COMMAND, 0, 0)], netem, [message(COMMAND, 0, 0, log_ms=11)])
    _, problems = link_summary(logs, "forward", a_scenario())
    assert causes(problems) == ["links.forward: netem counted 2 packets as released, its log has 1"]


_AT_START = "all late ones left in the first {} s, the worst at {} s: a stall at the start"


@pytest.mark.parametrize(
    ("late_ms", "n_late", "sentence"),
    [
        (
            6,
            3,
            "starved: 1 % of 200 packets left netem more than 6 ms late, allowed are 5 ms; "
            + _AT_START.format("0.01", "0.01"),
        ),
        (
            1.2,
            11,
            "starved: 11 of 200 packets left more than 1 ms late, allowed are 5%; "
            + _AT_START.format("0.02", "0.01"),
        ),
        (1.2, 10, None),
        (0.9, 200, None),
    ],
)
def test_a_starved_run_is_not_valid(tmp_path: Path, late_ms: float, n_late: int, sentence: str | None) -> None:
    netem = []
    for k in range(200):
        netem += [fate(COMMAND, k, k, 5), release(COMMAND, k, k, k + 5, k + 5 + (late_ms if k < n_late else 0))]
    _, problems = link_summary(write_run(tmp_path, netem=netem), "forward", a_scenario())
    assert causes(problems) == ([] if sentence is None else [f"links.forward: {sentence}"])


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
    forward, problems = link_summary(logs, "forward", a_scenario())
    assert problems == []
    assert (forward["sent"], forward["received"], forward["reordered"], forward["duplicated"]) == (4, 4, 0, 0)
    feedback, problems = link_summary(logs, "feedback", a_scenario())
    assert problems == []
    assert (feedback["sent"], feedback["offered"], feedback["received"]) == (0, 0, 0)
    assert feedback["loss_pct"] is feedback["loss_pct_interval_95"] is None
    assert feedback["delay_ms"]["realised"]["mean"] is feedback["release_error_us"]["p99"] is None


def test_order_in_netem_is_that_of_the_instants_whatever_the_order_in_the_log(tmp_path: Path) -> None:
    """1 and 3 crossed at once and stand behind 2 and 4 in the log; 5 did leave behind 6; 7 and 8 at one instant."""
    left_ms = {0: 1, 2: 21, 4: 41, 1: 11, 3: 31, 6: 61, 5: 62, 7: 71, 8: 71}
    netem = [fate(COMMAND, seq, 10 * seq, at_ms - 10 * seq) for seq, at_ms in sorted(left_ms.items())]
    netem += [release(COMMAND, seq, 10 * seq, at_ms, at_ms) for seq, at_ms in left_ms.items()]
    sent = [message(COMMAND, seq, 10 * seq) for seq in left_ms]
    link, _ = link_summary(write_run(tmp_path, sent, netem), "forward", a_scenario())
    assert link["reordered_in_netem"] == link["keys"][COMMAND]["reordered_in_netem"] == 1


def test_one_sentence_on_several_keys_stands_once_with_their_names(tmp_path: Path) -> None:
    keys = [f"tis/{hand}/measured_cp" for hand in ("MTML", "MTMR")] + ["tis/PSM2/setpoint_cp", "tis/PSM1/setpoint_cp"]
    network = {"forward": {"delay": {"kind": "constant", "delay_ms": 10}}}
    sent = [message(key, 0, 0) for key in keys]
    logs = write_run(tmp_path, sent, [fate(key, 0, 0, 5) for key in keys])
    link, _ = link_summary(logs, "forward", a_scenario(network=network))
    (sentence,) = [text for text in link["verdict"]["violations"] if "decided delay" in text]
    assert sentence.startswith(f"{', '.join(keys[:3])} and 1 more, each: decided delay: mean 5 ms")


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
    link, problems = link_summary(logs, "forward", a_scenario())
    (problem,) = problems
    assert "the patient used 1 message that the surgeon did not send" in problem
    assert link["not_sent"] == 1
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
    _, problems = link_summary(logs, "forward", a_scenario())
    assert causes(problems) == [
        "links.forward: 1 packets appear more than once in offered: tis/MTML/measured_cp",
        "links.forward: 1 packets: released or dropped but never offered; the first is tis/MTML/measured_cp seq 3",
        "links.forward: 1 packets: both released and dropped; the first is tis/MTML/measured_cp seq 2",
    ]


def test_a_packet_that_came_round_netem_is_listed(tmp_path: Path) -> None:
    logs = write_run(
        tmp_path,
        surgeon=[message(COMMAND, 0, 0), message(COMMAND, 1, 10)],
        netem=[*crossing(COMMAND, 0, 0), fate(COMMAND, 1, 10, None, "loss")],
        patient=[message(COMMAND, 0, 0, log_ms=11), message(COMMAND, 1, 10, log_ms=10.2)],
    )
    _, problems = link_summary(logs, "forward", a_scenario())
    assert causes(problems) == [
        "links.forward: 1 packets: received but never released; the first is tis/MTML/measured_cp seq 1"
    ]


@pytest.mark.parametrize("missing", ["surgeon", "netem", "patient"])
def test_a_missing_log_makes_its_figures_null_and_accuses_nobody(tmp_path: Path, missing: str) -> None:
    write_log(tmp_path, "surgeon", [message(COMMAND, k, 10 * k) for k in range(3)])
    write_log(tmp_path, "netem", [record for k in range(3) for record in crossing(COMMAND, k, 10 * k)])
    write_log(tmp_path, "patient", [message(COMMAND, k, 10 * k, log_ms=10 * k + 11) for k in range(3)])
    (tmp_path / f"{missing}.mcap").unlink()
    link, problems = link_summary(load_run(tmp_path), "forward", a_scenario())
    assert problems == []
    kept = {
        "surgeon": ("sent",),
        "netem": ("offered", "released", "dropped", "held_at_end", "foreign", "lost", "copied", "corrupted"),
        "patient": ("received", "duplicated", "reordered", "corrupted_rejected"),
    }
    for side, names in kept.items():
        for name in names:
            assert (link[name] is None) == (side == missing), name
    assert link["unplanned_loss"] is None


def test_after_a_damaged_senders_log_nobody_is_taken_for_a_stranger(tmp_path: Path) -> None:
    """The packets that the torn log no longer names were sent all the same: they are in no book."""
    cut_log(tmp_path, "surgeon", [message(COMMAND, k, 1000 * k) for k in range(10)], n_whole=5)
    write_log(tmp_path, "netem", [record for k in range(10) for record in crossing(COMMAND, k, 1000 * k)])
    write_log(tmp_path, "patient", [message(COMMAND, k, 1000 * k, log_ms=1000 * k + 11) for k in range(10)])
    link, problems = link_summary(load_run(tmp_path), "forward", a_scenario())
    assert (link["foreign"], link["sent"], link["offered"], link["received"], link["untold"]) == (0, 4, 4, 4, 6)
    assert problems == []


def test_a_log_that_lost_its_index_alone_knows_a_stranger(tmp_path: Path) -> None:
    write_log(tmp_path, "surgeon", [message(COMMAND, 0, 0)])
    write_log(tmp_path, "netem", [record for k in range(3) for record in crossing(COMMAND, k, 10 * k)])
    write_log(tmp_path, "patient", [message(COMMAND, k, 10 * k, log_ms=10 * k + 11) for k in range(3)])
    whole = (tmp_path / "surgeon.mcap").read_bytes()
    (tmp_path / "surgeon.mcap").write_bytes(whole[:-20])
    link, _ = link_summary(load_run(tmp_path), "forward", a_scenario())
    assert (link["foreign"], link["offered"], link["untold"]) == (2, 1, 0)
