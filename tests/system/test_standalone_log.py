"""The log of a real `tis netem` between two real networks, and what the other commands make of its folder."""

import json
import time
from typing import Any

import pytest
from typer.testing import CliRunner

from tests.common.runtime.live_zenoh import a_client, soon
from tests.system.conftest import Start, is_right_but_for_the_machine
from tis.deploy.cli.main import app

pytestmark = pytest.mark.live

N = 200


def _tis(*words: str) -> tuple[int, str]:
    """Return the exit code and all that was said, in one line whatever the width."""
    result = CliRunner().invoke(app, list(words))
    assert "Traceback" not in result.output
    return result.exit_code, " ".join(result.output.split())


def test_a_log_between_two_networks_is_a_folder_for_every_command(start: Start, endpoints: tuple[str, str]) -> None:
    west, east = endpoints
    loss = "forward.loss={kind: bernoulli, p_loss: 0.2}"
    delay = "forward.delay={kind: uniform, low_ms: 20, high_ms: 40}"
    tis = start("netem", "demo/**", "--west", west, "--east", east, "--set", delay, "--set", loss, "--seed", "3",
                "--duration-s", "6")  # fmt: skip
    came: list[bytes] = []
    with a_client(west) as here, a_client(east) as there:
        held = there.declare_subscriber("demo/**", lambda sample: came.append(sample.payload.to_bytes()))

        def one_came() -> bool:
            here.put("demo/pose", b"first")
            return bool(came)

        assert any(soon(one_came) for _ in range(7))
        for _ in range(N):
            here.put("demo/pose", bytes(100))
            time.sleep(0.01)
        held.undeclare()  # type: ignore[no-untyped-call]
        code, _, err = tis.wait()
    assert code == 0, err
    names = {path.name for path in tis.run_dir.iterdir()}
    assert names == {"netem.mcap", "network.yaml", "manifest.json", "audit.jsonl"}
    code, out = _tis("summarize", str(tis.run_dir))
    summary = tis.summary()
    assert is_right_but_for_the_machine(code, summary), summary["problems"]
    assert summary["processors"]["netem"]["own_pct"] > 0
    link = summary["links"]["forward"]
    assert link["offered"] > N
    assert link["offered"] == link["released"] + link["dropped"]
    assert link["verdict"]["faithful"] or all("release error" in text for text in link["verdict"]["violations"])
    assert link["requested"]["loss_pct"] == pytest.approx(20)
    assert 20 <= link["delay_ms"]["decided"]["p50"] <= 40
    manifest: dict[str, Any] = json.loads((tis.run_dir / "manifest.json").read_text())
    assert manifest["command"].startswith("tis netem 'demo/**' --west")
    assert manifest["command"] == summary["command"]
    code, out = _tis("info", str(tis.run_dir))
    assert code == 0
    assert "forward (west to east): delay 30 ms" in out
    code, out = _tis("net", "fit", str(tis.run_dir))
    assert code == 0
    assert "uniform" in out


def test_a_full_buffer_is_said_while_it_runs_and_in_what_is_left(start: Start, endpoints: tuple[str, str]) -> None:
    west, east = endpoints
    delay = "forward.delay={kind: constant, delay_ms: 1000}"
    tis = start("netem", "demo/**", "--west", west, "--east", east, "--set", delay, "--set", "buffer.max_packets=5",
                "--duration-s", "6")  # fmt: skip
    came: list[bytes] = []
    with a_client(west) as here, a_client(east) as there:
        held = there.declare_subscriber("demo/**", lambda sample: came.append(sample.payload.to_bytes()))

        def one_came() -> bool:
            for _ in range(20):
                here.put("demo/image", bytes(100))
            return bool(came)

        assert any(soon(one_came) for _ in range(7))
        held.undeclare()  # type: ignore[no-untyped-call]
        code, out, err = tis.wait()
    assert code == 0, err
    full = "buffer of 5 messages full"
    assert err.count(f"netem: warning: forward (west to east): {full}") == 1
    assert "overflow" in out
    code, out = _tis("summarize", str(tis.run_dir))
    link = tis.summary()["links"]["forward"]
    n_dropped = link["dropped_by"]["overflow"]
    assert n_dropped == link["dropped"] > 0
    assert link["verdict"]["faithful"] is False
    sentence = f"{full}: {n_dropped} messages dropped of {link['offered']} offered"
    assert any(sentence in text for text in link["verdict"]["violations"])
    assert sentence in out
