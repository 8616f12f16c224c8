"""Sight between real processes: the stamps of undamaged pictures are those of their frames, and the books balance."""

from pathlib import Path

import pytest

from tests.system.conftest import StartHere, is_right_but_for_the_machine
from tis.common.records import COUNTERS
from tis.common.sight_records import CAMERA, SCREEN
from tis.deploy.logs.read.load import load_run

pytestmark = pytest.mark.live
pytest.importorskip("PIL", reason="the extra report is not installed")


def test_stamps_are_those_of_the_frames_in_a_live_run_that_signs_them(run_here: StartHere, tmp_path: Path) -> None:
    secret = tmp_path / "secret.txt"
    secret.write_text("0123456789abcdef" * 4)
    secret.chmod(0o600)
    signed = f"security={{kind: none, sign: true, secret_file: {secret}}}"
    settings = ("sight.width=320", "sight.height=240", "estimators=[hold]", "active_estimator=hold", signed)
    tis = run_here("run", "sight", "--duration-s", "3", *(word for one in settings for word in ("--set", one)))
    code, _, err = tis.wait()
    summary = tis.summary()
    # a process that does not get to read in time has its queue of fragments full
    assert is_right_but_for_the_machine(code, summary, "nobody planned"), (err, summary["problems"])
    logs = load_run(tis.run_dir)
    sent = {row["frame"]: row for row in logs.of("patient", CAMERA)}
    seen = logs.of("surgeon", SCREEN)
    complete = [row for row in seen if row["state"] == "complete"]
    assert len(complete) > 5
    assert max(row["command"] for row in sent.values()) > 0, "the camera believes its own side's poses"
    assert not [row for row in seen if row["state"] == "torn"]
    for row in complete:
        stamp = (row["frame"], sent[row["frame"]]["command"])
        assert (row["top_frame"], row["top_command"]) == (row["bottom_frame"], row["bottom_command"]) == stamp
    counts = {row["name"]: row["value"] for row in logs.of("surgeon", COUNTERS)}
    video = summary["links"]["feedback"]["keys"]["tis/ECM/video"]
    assert counts["video_received"] == video["received"] > 0
    assert counts["video_corrupted"] == counts["video_forged"] == 0
