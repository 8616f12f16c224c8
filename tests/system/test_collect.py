"""`tis collect` over Zenoh with the certificates of a run: netem's host collects, the others connect to it."""

import shutil
import signal
import subprocess
import sys
from contextlib import ExitStack
from pathlib import Path

import pytest

from tests.deploy.commands import call
from tests.system.conftest import HOLD
from tis.deploy.tools.certificates import issue, new_authority

pytestmark = pytest.mark.live
_ROOT = Path(__file__).resolve().parents[2]
_TIS = [sys.executable, "-m", "tis.deploy.cli.main"]
_SIDES = ("surgeon", "netem", "patient")


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the folder of a run, for all tests of this file."""
    path = tmp_path_factory.mktemp("collected") / "run"
    words = (*HOLD, "--duration-s", "8", "--no-report", "--no-merge")
    code, _, err = call("twin", "default", *words, "--run-dir", str(path))
    assert code in (0, 5), err
    return path


@pytest.fixture
def apart(tmp_path: Path, run: Path) -> Path:
    """Return a folder with the logs of a run, each in a folder of its own, and with certificates."""
    new_authority(tmp_path / "certs")
    for side in _SIDES:
        (tmp_path / side).mkdir()
        shutil.copy(run / f"{side}.mcap", tmp_path / side)
        issue(tmp_path / "certs", side)
    return tmp_path


def _start(stack: ExitStack, folder: Path, side: str, *words: str) -> subprocess.Popen[str]:
    brief = () if "--offer" in words else ("--no-report", "--no-merge")
    command = [*_TIS, "collect", *words, *brief, "-c", str(folder / "certs" / side / "zenoh.json5")]
    process = subprocess.Popen(command, cwd=_ROOT, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
    stack.callback(process.communicate)
    stack.callback(process.kill)
    return process


@pytest.mark.slow
def test_netems_host_collects_what_the_others_offer_with_their_certificates(
    apart: Path, run: Path, endpoints: tuple[str, str]
) -> None:
    west, east = (endpoint.replace("tcp/", "tls/") for endpoint in endpoints)
    with ExitStack() as stack:
        offers = [
            _start(stack, apart, side, "--offer", str(apart / side), "--connect", endpoint)
            for side, endpoint in (("surgeon", west), ("patient", east))
        ]
        words = ("--listen", west, "--listen", east, "--run-dir", str(apart / "netem"), "--wait-s", "60")
        collecting = _start(stack, apart, "netem", *words)
        out, err = collecting.communicate(timeout=120)
        assert collecting.returncode in (0, 5), err
        for offer in offers:
            offer.send_signal(signal.SIGINT)
            assert offer.wait(timeout=60) == 0
    for side in _SIDES:
        assert (apart / "netem" / f"{side}.mcap").read_bytes() == (run / f"{side}.mcap").read_bytes()
    assert {"summary.json", "manifest.json", "scenario.yaml"} <= {path.name for path in (apart / "netem").iterdir()}
    assert "default (twin" in out


def test_nobody_without_a_certificate_reads_or_offers_logs(apart: Path, endpoints: tuple[str, str]) -> None:
    west = endpoints[0].replace("tcp/", "tls/")
    new_authority(apart / "other" / "certs")
    issue(apart / "other" / "certs", "surgeon")
    with ExitStack() as stack:
        words = ("--listen", west, "--run-dir", str(apart / "netem"), "--wait-s", "8")
        collecting = _start(stack, apart, "netem", *words)
        offer = _start(stack, apart / "other", "surgeon", "--offer", str(apart / "surgeon"), "--connect", west)
        _, err = collecting.communicate(timeout=60)
        assert collecting.returncode == 3
        assert "nobody offered a log of surgeon and patient in time" in err
        assert offer.poll() is None
    assert {path.name for path in (apart / "netem").iterdir()} == {"netem.mcap"}


@pytest.mark.parametrize("words", [("--offer", "{folder}/netem"), ("--run-dir", "{folder}/netem")])
def test_an_end_does_not_listen_where_anybody_may_connect(apart: Path, words: tuple[str, ...]) -> None:
    given = [word.format(folder=apart) for word in words]
    code, _, err = call("collect", *given, "--listen", "tcp/0.0.0.0:7450")
    assert code == 2
    assert "must be on loopback without clients' certificates (mTLS) or passwords" in err
