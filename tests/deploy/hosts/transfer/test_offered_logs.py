"""What a run folder offers: the sides' logs, and no other file, whatever is asked for."""

import hashlib
import os
from pathlib import Path

import pytest

from tis.common.errors import DataError
from tis.deploy.hosts.transfer.offered_logs import log_names, offered_logs, opened_log, read_range

_CONTENT = bytes(range(256)) * 10_000


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def test_logs_of_sides_and_of_their_restarts_are_offered_and_nothing_else(tmp_path: Path) -> None:
    logs = ["netem.mcap", "patient.mcap", "patient_2.mcap", "patient_recovered.mcap", "surgeon_13_recovered.mcap"]
    others = ["run.mcap", "scenario.yaml", "patient.mcap.part", "xpatient.mcap", "patient_2.mcap\n", "patient_a.mcap"]
    for name in [*logs, *others]:
        (tmp_path / name).write_text(name)
    (tmp_path / "surgeon.mcap").symlink_to("/etc/passwd")
    (tmp_path / "netem_2.mcap").mkdir()
    os.mkfifo(tmp_path / "netem_3.mcap")
    assert log_names(tmp_path) == logs


@pytest.mark.parametrize(
    "name", ["../secret", "/etc/passwd", "scenario.yaml", "surgeon.mcap", "netem_2.mcap", "netem_3.mcap", ""]
)
def test_no_other_file_is_opened_whatever_its_name_or_kind(tmp_path: Path, name: str) -> None:
    (tmp_path / "scenario.yaml").write_text("secret")
    (tmp_path / "surgeon.mcap").symlink_to(tmp_path / "scenario.yaml")
    (tmp_path / "netem_2.mcap").mkdir()
    os.mkfifo(tmp_path / "netem_3.mcap")  # whose other end nobody opens: it must not be waited for
    with pytest.raises(DataError), opened_log(tmp_path, name):
        pass


@pytest.mark.parametrize("n_part", [0, 1, 1 << 20, len(_CONTENT), len(_CONTENT) + 1])
def test_an_offer_has_the_digests_of_the_whole_and_of_the_part(tmp_path: Path, n_part: int) -> None:
    (tmp_path / "netem.mcap").write_bytes(_CONTENT)
    [offer] = offered_logs(tmp_path, {"netem.mcap": n_part})
    assert (offer.n_bytes, offer.sha256) == (len(_CONTENT), _sha(_CONTENT))
    assert offer.part_sha256 == (None if n_part > len(_CONTENT) else _sha(_CONTENT[:n_part]))


@pytest.mark.parametrize(("begin", "end"), [(0, 10), (5, 1_500_000), (2_560_000, 2_560_000), (2_559_999, 1 << 40)])
def test_a_range_is_these_bytes_of_the_log(tmp_path: Path, begin: int, end: int) -> None:
    (tmp_path / "netem.mcap").write_bytes(_CONTENT)
    assert b"".join(read_range(tmp_path, "netem.mcap", begin, end)) == _CONTENT[begin:end]


def test_a_folder_that_is_not_there_is_a_fault(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="none: cannot be read: No such file"):
        log_names(tmp_path / "none")
