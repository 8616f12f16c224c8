"""Sight between real processes: the stamps of undamaged pictures are those of their frames, and the books balance."""

import json
import subprocess
import sys
import time
from base64 import b64encode
from io import BytesIO
from pathlib import Path

import pytest
import zenoh

from tests.system.conftest import StartHere, is_right_but_for_the_machine
from tests.system.test_foreign_doors import a_patient_client, await_run
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


CAMERA_PROGRAM = Path(__file__).resolve().parents[2] / "examples" / "camera.py"


def _bomb() -> bytes:
    image = pytest.importorskip("PIL.Image")
    out = BytesIO()
    image.new("RGB", (4096, 4096)).save(out, "JPEG")
    return out.getvalue()


def _lie(east: str) -> None:
    """Publish on the camera's key what is no frame, what is too long, and images with too many pixels."""
    bomb = json.dumps({"format": "jpeg", "data": b64encode(_bomb()).decode()})
    with zenoh.open(a_patient_client(east)) as session:
        await_run(session)
        for lie in [b"junk", b"x" * (7 << 19), b'{"format": "h264", "data": "AAAA"}', bomb] * 4:
            session.put("tis/ECM/camera", lie, congestion_control=zenoh.CongestionControl.BLOCK)
            time.sleep(0.05)


def test_a_camera_of_others_joins_and_what_is_no_frame_of_it_is_counted(
    run_here: StartHere, endpoints: tuple[str, str]
) -> None:
    west, east = endpoints
    settings = (
        "sight.camera=external",
        "network.feedback.loss.p_loss=0",
        "estimators=[hold]",
        "active_estimator=hold",
    )
    hosts = ("--set", f"hosts={json.dumps({'west': west, 'east': east})}")
    words = ("run", "sight", "--duration-s", "5", *hosts, *(word for one in settings for word in ("--set", one)))
    program = subprocess.Popen([sys.executable, str(CAMERA_PROGRAM), east, "stamped"], stdout=subprocess.PIPE)
    try:
        tis = run_here(*words, meanwhile=lambda _: _lie(east))
        code, _, err = tis.wait()
        program.communicate(timeout=30)
    finally:
        program.kill()
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary, "nobody planned"), (err, summary["problems"])
    camera, sight = summary["external_camera"], summary["sight"]
    refused = camera["refused"]
    assert (refused["undecodable"], refused["other_format"], refused["unread"]) == (4, 4, 4)
    assert camera["unreadable"] <= 4
    assert sight["frames"]["undecodable"] >= camera["unreadable"] > 0
    assert sight["frames"]["complete"] > 5
    assert sight["frames"]["torn"] == 0
    assert sight["hand_to_eye_ms"]["p50"] > sight["glass_to_glass_ms"]["p50"] > 0
    assert sight["quality"] is None
