"""The three sides on three hosts: network namespaces of this machine, joined by two cables through netem's."""

import json
import shutil
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.deploy.commands import call
from tests.system.conftest import is_right_but_for_the_machine
from tests.system.hosts import IP, Hosts, hosts
from tis.deploy.logs.read.load import load_run
from tis.deploy.tools.certificates import issue, new_authority

pytestmark = pytest.mark.live
__all__ = ["hosts"]
_ROOT = Path(__file__).resolve().parents[2]
_TIS = [sys.executable, "-m", "tis.deploy.cli.main"]

SCENARIO = """\
version: 1
name: three_hosts
duration_s: 3
source: {kind: synthetic}
hosts: {west: tls/10.77.1.1:7447, east: tls/10.77.2.1:7448}
security: {kind: mtls}
network: {forward: {delay: {kind: constant, delay_ms: 20}}, feedback: {delay: {kind: constant, delay_ms: 20}}}
identification: {train: MODEL_FILE}
estimators: [hold, innovations_kf]
"""


def test_sides_on_three_hosts_meet_in_any_order_and_their_logs_make_one_run(
    hosts: Hosts, tmp_path: Path, model_file: Path, without_report: None
) -> None:
    for side, other in (("surgeon", "10.77.2.1"), ("patient", "10.77.1.1")):
        found = subprocess.run(hosts.command(side, IP, "route", "get", other), capture_output=True, check=False)
        assert found.returncode != 0, f"there is a way round netem: {found.stdout!r}"
    (tmp_path / "s.yaml").write_text(SCENARIO.replace("MODEL_FILE", str(model_file)))
    new_authority(tmp_path / "certs")
    for side in ("surgeon", "netem", "patient"):
        issue(tmp_path / "certs", side, ("10.77.1.1", "10.77.2.1") if side == "netem" else ())
        shutil.copytree(tmp_path / "certs" / side, tmp_path / side / "certs" / side)  # each host has its own only
    processes: dict[str, subprocess.Popen[str]] = {}
    with ExitStack() as stack:
        for side in ("patient", "surgeon", "netem"):  # whom the others wait for comes last
            words = [*_TIS, side, str(tmp_path / "s.yaml"), "--run-dir", str(tmp_path / side), "--wait-s", "60"]
            process = subprocess.Popen(
                hosts.command(side, *words),
                cwd=tmp_path / side, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
            processes[side] = stack.enter_context(process)
            stack.callback(process.kill)
        said = {side: process.communicate(timeout=120)[1] for side, process in processes.items()}
    assert {side: process.returncode for side, process in processes.items()} == dict.fromkeys(said, 0), said

    gathered = tmp_path / "gathered"
    gathered.mkdir()
    for side in processes:
        shutil.copy(tmp_path / side / f"{side}.mcap", gathered)
    code, out, err = call("summarize", str(gathered))
    summary = json.loads((gathered / "summary.json").read_text())
    assert summary["security"] == "mtls"
    assert not any(summary["refused"].values())
    assert is_right_but_for_the_machine(code, summary), out + err
    assert load_run(gathered).problems() == []
    assert "identical, bit for bit" in call("replay", str(gathered))[1]


def test_netem_does_not_listen_where_anybody_may_connect(tmp_path: Path) -> None:
    text = SCENARIO.replace("tls/", "tcp/").replace("security: {kind: mtls}\n", "").replace("train: MODEL_FILE", "")
    (tmp_path / "s.yaml").write_text(text)
    code, _, err = call("netem", str(tmp_path / "s.yaml"), "--run-dir", str(tmp_path / "run"))
    assert code == 2
    rule = (
        "must be on loopback without clients' certificates (mTLS) or passwords, unless --insecure says that anybody "
        "may connect"
    )
    assert err == f"netem: zenoh: --listen: {rule} (got 'tcp/10.77.1.1:7447')\n"
    assert not (tmp_path / "run").exists()
