"""Emergency stops of a live run, through an outage of both directions, by clients with different rights."""

import json
from collections.abc import Callable
from pathlib import Path

import pytest

from tests.deploy.commands import call_in_one_line
from tests.system.conftest import HOLD, Start
from tis.common.runtime.ports import free_endpoints

pytestmark = pytest.mark.live
_OUTAGE = "network.timeline=[{at_s: 0.5, for_s: 8, direction: both, set: {outage: true}}]"
_RULE = "patient.safety={release: named, releasers: [head, both]}"
_Call = Callable[..., tuple[int, str, str]]


@pytest.fixture
def passwords(tmp_path: Path) -> Path:
    """Return a file of passwords for sides and clients."""
    file = tmp_path / "passwords.txt"
    names = ("surgeon", "netem", "patient", "operator", "head", "both")
    file.write_text("".join(f"{name}:{name}-secret\n" for name in names))
    file.chmod(0o600)
    return file


def _client(folder: Path, name: str) -> _Call:
    """Return `tis stop` as the client of this name."""
    file = folder / f"{name}.json5"
    login = {"user": name, "password": f"{name}-secret"}
    file.write_text(json.dumps({"transport": {"auth": {"usrpwd": login}}}))
    file.chmod(0o600)
    return lambda *words: call_in_one_line("stop", *words, "-c", str(file))


def test_stops_reach_the_patient_in_an_outage_and_end_one_by_one(
    start: Start, tmp_path: Path, passwords: Path
) -> None:
    west, east = free_endpoints()
    security = f"security={{kind: password, file: {passwords}, control: [operator, both]}}"
    settings = (_OUTAGE, _RULE, security, f"hosts={{west: {west}, east: {east}}}")
    words = [word for setting in settings for word in ("--set", setting)]
    tis = start("run", "default", "--duration-s", "10", *HOLD, *words)
    operator, head, both = (_client(tmp_path, name) for name in ("operator", "head", "both"))
    tis.await_log("patient", 30_000)

    code, out, err = operator("a hand in the way", "--connect", west)
    assert (code, out[:7]) == (0, "stopped"), err
    token = out.split(" --release ")[1]
    code, out, err = head("smoke", "--connect", east)
    assert (code, "beside 1 other stop" in out) == (0, True), err

    # who has stopped may not release here
    code, _, err = operator("--release", token, "--connect", west)
    assert (code, "only the clients in patient.safety.releasers" in err) == (3, True), err
    code, out, err = head("--release", token, "--connect", east)
    assert (code, out[:8]) == (0, "released"), err
    assert "the arms stay stopped by 1 other stop" in out
    assert "smoke" in out
    code, _, err = head("--release", token, "--connect", west)
    assert (code, "is in force: the arms are stopped by 1 stop" in err) == (2, True), err
    # another right beside takes none away
    code, out, err = both("--release", "--connect", west)
    assert (code, out[:8], "stay" in out) == (0, "released", False), err

    code, _, err = operator("--connect", west, "--prefix", "another")
    assert code == 3
    assert "no patient of session another confirmed" in err
    code, _, err = tis.wait()
    assert code in (0, 5), err
    left = tis.summary()["safety"]["left"]
    assert (left["emergency_stops"], left["releases"], left["releases_by_others"]) == (2, 2, 1)
    assert (left["stop_requests_refused"], left["stop_requests_flooded"]) == (1, 0)
    assert tis.summary()["links"]["forward"]["foreign"] == 0
