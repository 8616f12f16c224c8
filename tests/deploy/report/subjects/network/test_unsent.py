"""Messages that nobody sent: told by number and content, from hand-made logs."""

from pathlib import Path

from tests.deploy.report.hand_made import COMMAND, cut_log, fate, message, write_log, write_run
from tests.deploy.report.partial import causes
from tis.common.node import Record
from tis.deploy.logs.read.load import load_run
from tis.deploy.report.subjects.network.link_books import Unsent, unsent, unsent_problem

MS = 1_000_000


def _sent(n: int) -> list[Record]:
    return [message(COMMAND, k, 10 * k, sample_ms=10 * k) for k in range(n)]


def _received(n: int) -> list[Record]:
    return [message(COMMAND, k, 10 * k, log_ms=10 * k + 40, sample_ms=10 * k) for k in range(n)]


def test_what_was_sent_is_not_forged_late_twice_or_lost(tmp_path: Path) -> None:
    received = _received(5)
    logs = write_run(tmp_path, _sent(7), [], [*received[:3], received[1], received[4], received[3]])
    assert unsent(logs, "forward", "tis") == Unsent(0, "", 0)
    assert unsent_problem(unsent(logs, "forward", "tis"), "forward") == []


def test_a_number_that_was_never_sent_is_forged(tmp_path: Path) -> None:
    forged = message(COMMAND, 4_000_000_000, 30, log_ms=31, sample_ms=20)
    logs = write_run(tmp_path, _sent(5), [], [*_received(5), forged])
    found = unsent(logs, "forward", "tis")
    assert found == Unsent(1, COMMAND, 31 * MS)
    assert causes(unsent_problem(found, "forward")) == [
        f"links.forward: the patient used 1 message that the surgeon did not send; the first on {COMMAND}, which "
        "arrived at 0.031 s"
    ]


def test_other_content_under_a_known_number_is_forged_unless_it_came_second(tmp_path: Path) -> None:
    early = [message(COMMAND, k, 10 * k, log_ms=5 + k, sample_ms=10 * k + 1) for k in (3, 4)]
    late = [message(COMMAND, k, 10 * k, log_ms=90 + k, sample_ms=10 * k + 1) for k in (0, 1)]
    logs = write_run(tmp_path, _sent(5), [], [*early, *_received(5), *late])
    assert unsent(logs, "forward", "tis") == Unsent(2, COMMAND, 8 * MS)


def test_old_content_under_a_new_number_is_forged(tmp_path: Path) -> None:
    replayed = [message(COMMAND, 100 + k, 10 * k, log_ms=60 + k, sample_ms=10 * k) for k in range(3)]
    logs = write_run(tmp_path, _sent(5), [], [*_received(5), *replayed])
    assert unsent(logs, "forward", "tis") == Unsent(3, COMMAND, 60 * MS)


def test_bits_that_netem_flipped_are_not_forged(tmp_path: Path) -> None:
    corrupted = message(COMMAND, 2, 20, log_ms=60, sample_ms=21)
    netem = [fate(COMMAND, 2, 20, 10, flipped=3)]
    logs = write_run(tmp_path, _sent(3), netem, [*_received(2), corrupted])
    assert unsent(logs, "forward", "tis") == Unsent(0, "", 0)


def test_without_the_senders_whole_log_nobody_is_accused(tmp_path: Path) -> None:
    write_log(tmp_path, "netem", [])
    write_log(tmp_path, "patient", _received(5))
    assert unsent(load_run(tmp_path), "forward", "tis") is None
    cut_log(tmp_path, "surgeon", _sent(10), n_whole=2)
    assert unsent(load_run(tmp_path), "forward", "tis") is None
    assert unsent_problem(None, "forward") == []


def test_with_the_cameras_log_cut_off_no_picture_is_called_forged_and_the_cut_is_told(tmp_path: Path) -> None:
    picture = [message("tis/ECM/video", k, 10 * k, log_ms=10 * k + 40) for k in range(5)]
    logs = write_run(tmp_path, picture)
    assert unsent(logs, "feedback", "tis") == Unsent(5, "tis/ECM/video", 40 * MS)
    cut_log(tmp_path, "patient_camera", [message("tis/ECM/video", k, 10 * k) for k in range(5)], n_whole=2)
    logs = load_run(tmp_path)
    assert unsent(logs, "feedback", "tis") == Unsent(0, "", 0)
    assert [text for text in causes(logs.problems()) if "patient_camera.mcap: log is damaged" in text]
