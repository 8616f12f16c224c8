from pathlib import Path

from tests.deploy.report.hand_made import ARM, COMMAND, MS, answer, message, write_log, write_run
from tis.common.channels import VIDEO
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.measured_values import OneWay


def test_delays_variation_and_losses_of_two_keys(tmp_path: Path) -> None:
    """Commands take 10, 14 and 12 ms, the arm's 30 and 31; one of each is lost, and one comes twice."""
    sent_ms = {COMMAND: (0, 33, 66, 100), ARM: (1, 34, 67)}
    surgeon = [message(key, seq, at) for key, times in sent_ms.items() for seq, at in enumerate(times)]
    patient = [
        message(COMMAND, 2, 66, log_ms=78),  # overtook the one before
        message(COMMAND, 1, 33, log_ms=47),
        message(COMMAND, 0, 0, log_ms=10),
        message(COMMAND, 0, 0, log_ms=90),
        message(ARM, 0, 1, log_ms=31),
        message(ARM, 2, 67, log_ms=98),
        message(ARM, 9, 0, log_ms=99),  # nobody sent it
    ]
    found = OneWay.of(write_run(tmp_path, surgeon=surgeon, patient=patient), "forward", "tis")
    assert found is not None
    assert len(found.sent_ns) == 5
    by_sending = dict(zip((found.sent_ns // MS).tolist(), (found.one_way_ns // MS).tolist(), strict=True))
    assert by_sending == {0: 10, 33: 14, 66: 12, 1: 30, 67: 31}
    above = dict(zip((found.sent_ns // MS).tolist(), (found.pdv_ns // MS).tolist(), strict=True))
    assert above == {0: 0, 33: 4, 66: 2, 1: 0, 67: 1}
    # sent in this order: command 0, arm 0, command 1, arm 1 (lost), command 2, arm 2, command 3 (lost)
    assert found.lost.tolist() == [False, False, False, True, False, False, True]


def test_answers_go_the_other_way_and_without_a_log_nobody_knows(tmp_path: Path) -> None:
    logs = write_run(tmp_path, surgeon=[answer(0, 20, 0, log_ms=29)], patient=[answer(0, 20, 0), answer(1, 53, 0)])
    found = OneWay.of(logs, "feedback", "tis")
    assert found is not None
    assert (found.one_way_ns.tolist(), found.lost.tolist()) == ([9 * MS], [False, True])
    alone = tmp_path / "alone"
    alone.mkdir()
    write_log(alone, "patient", [answer(0, 20, 0)])
    assert OneWay.of(load_run(alone), "feedback", "tis") is None


def test_the_picture_is_judged_by_its_own_figures(tmp_path: Path) -> None:
    """A busy screen takes its messages late; no force of the same network is."""
    picture = [message(VIDEO.key("tis"), seq, 20, log_ms=log_ms) for seq, log_ms in enumerate((None, 500))]
    logs = write_run(
        tmp_path, surgeon=[answer(0, 20, 0, log_ms=29), picture[1]], patient=[answer(0, 20, 0), *picture]
    )
    found = OneWay.of(logs, "feedback", "tis")
    assert found is not None
    assert (found.one_way_ns.tolist(), found.lost.tolist()) == ([9 * MS], [False])
