"""Five attacks on a live run in four kinds of security: what refuses them, says them, and names who did it.

``python -m tests.system.attack_table TABLE.json [KIND ...]`` runs all, for some minutes, and writes the table.
"""

import json
import os
import queue
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any, Final

import zenoh
from mcap.reader import make_reader

from tis.common.audit import AUDIT_FILE, verify
from tis.common.messages import CODE_BYTES, HEADER_BYTES, Header, decode
from tis.common.peer_life import Beat
from tis.common.runtime.credentials import credentials
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure
from tis.common.scenario.security import Mtls, NoSecurity, Password, Security
from tis.common.units import NS_PER_S, sample_instant_ns
from tis.deploy.tools.certificates import issue, new_authority

_LEAD_S: Final = 0.02
_NOT_REACHED: Final = "not reached: repeat it"
ROOT: Final = Path(__file__).resolve().parents[2]
ATTACKS: Final = (
    "stranger on west",
    "stranger on east",
    "netem's host",
    "old run replayed",
    "observer's certificate",
)
KINDS: Final = ("open", "password", "mtls", "signed")
_NAMES: Final = ("surgeon", "netem", "patient", "watcher")
Message = tuple[str, bytes, bytes]
"""Key, payload and attachment."""
_KEYS: Final = ("tis/MTML/measured_cp", "tis/PSM2/setpoint_cp")
_ALTERED: Final = """
import re
import sys
if "netem" in " ".join(sys.orig_argv):
    from tis.netem.bridge import bridge
    before = bridge.Egress.send
    def send(self, put, payload):
        if put.quality[0].endswith(("MTML/measured_cp", "PSM2/setpoint_cp")):
            payload = re.sub(rb'"gripper_rad":[-+.0-9e]+', b'"gripper_rad":0.123', bytes(payload))
        before(self, put, payload)
    bridge.Egress.send = send
"""
"""Put on the path of netem's process: each sample leaves with another opening of the gripper."""


def _security(kind: str, folder: Path) -> tuple[Security, str]:
    if kind == "open":
        return NoSecurity(kind="none"), "{kind: none}"
    if kind == "password":
        file = folder / "passwords.txt"
        return Password(kind="password", file=str(file)), f"{{kind: password, file: {file}, observers: [watcher]}}"
    certs, sign = folder / "certs", ", sign: true" if kind == "signed" else ""
    return Mtls(kind="mtls", folder=str(certs)), f"{{kind: mtls, folder: {certs}, observers: [watcher]{sign}}}"


@contextmanager
def _client(endpoint: str, proof: dict[str, Any]) -> Iterator[zenoh.Session | None]:
    config = configure("client", ZenohOptions(connect=[endpoint], credentials=proof))
    for _ in range(3):  # a busy router may take longer than an attempt
        with suppress(zenoh.ZError), zenoh.open(config) as session:
            yield session
            return
    yield None


def _forge(endpoint: str, proof: dict[str, Any]) -> None:
    """Send the next sample of each key once one is heard."""
    with _client(endpoint, proof) as session:
        if session is None:
            return

        heard: queue.Queue[Message] = queue.Queue()

        def take(sample: zenoh.Sample) -> None:
            attachment = b"" if sample.attachment is None else sample.attachment.to_bytes()
            heard.put((str(sample.key_expr), sample.payload.to_bytes(), attachment))

        session.declare_subscriber("tis/**", take, allowed_origin=zenoh.Locality.REMOTE)
        until_s = time.monotonic() + 1.5
        while (left_s := until_s - time.monotonic()) > 0:
            with suppress(queue.Empty):
                key, payload, attachment = heard.get(timeout=left_s)
                header = Header.unpack(attachment)
                if key in _KEYS and header is not None:
                    at_ns = str(sample_instant_ns(header.seq + 1, 30)).encode()
                    forged = re.sub(rb'"sample_ns":\d+', b'"sample_ns":' + at_ns, payload)
                    forged = re.sub(rb'"gripper_rad":[-+.0-9e]+', b'"gripper_rad":0.123', forged)
                    session.put(key, forged, attachment=header._replace(seq=header.seq + 1).pack())
        session.put(_KEYS[0], b"{}", attachment=Header(9).pack())  # also where nothing is heard
        time.sleep(0.3)


def _replay(endpoint: str, proof: dict[str, Any], recorded: list[Message]) -> None:
    """Send an old run's samples under this run's number, each a moment before its time, by netem's signs of life."""
    with _client(endpoint, proof) as session:
        if session is None:
            return
        beats: queue.Queue[bytes] = queue.Queue()
        session.declare_subscriber("tis/@tis/beat/netem", lambda sample: beats.put(sample.payload.to_bytes()))
        beat = decode(beats.get(timeout=5), Beat)
        begun_s = time.monotonic() - beat.at_ns / NS_PER_S
        until_s = time.monotonic() + 1.5
        for key, payload, attachment in recorded:
            header = Header.unpack(attachment)
            if header is None:
                continue
            left_s = begun_s + sample_instant_ns(header.seq, 30) / NS_PER_S - _LEAD_S - time.monotonic()
            if left_s > 0 and time.monotonic() < until_s:
                time.sleep(left_s)
                own = header._replace(run_id=beat.run_id).pack() + attachment[HEADER_BYTES:]
                session.put(key, payload, attachment=own)
        time.sleep(0.3)


def _attack(kind: str, attack: str, folder: Path, recorded: list[Message]) -> dict[str, Any]:
    run_dir = folder / f"{kind} {attack}".replace(" ", "_").replace("'", "")
    security, text = _security(kind, folder)
    scheme = "tls" if isinstance(security, Mtls) else "tcp"
    west, east = (one.replace("tcp/", f"{scheme}/") for one in free_endpoints())
    settings = (
        f"hosts={{west: {west}, east: {east}}}", f"security={text}", "estimators=[hold]", "active_estimator=hold",
        "patient.orientation={methods: [hold], active: hold}",
    )  # fmt: skip
    words = [word for one in settings for word in ("--set", one)]
    env = dict(os.environ)
    if attack == "netem's host":
        (folder / "altered").mkdir(exist_ok=True)
        (folder / "altered" / "sitecustomize.py").write_text(_ALTERED)
        env["PYTHONPATH"] = str(folder / "altered")
    shutil.rmtree(run_dir, ignore_errors=True)
    command = [sys.executable, "-m", "tis.deploy.cli.main", "run", "default", "--duration-s", "12", "--run-dir",
               str(run_dir), *words]  # fmt: skip
    run = subprocess.Popen(command, cwd=ROOT, env=env, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
    log, until_s = run_dir / "patient.mcap", time.monotonic() + 60
    while run.poll() is None and time.monotonic() < until_s and not (log.exists() and log.stat().st_size > 12_000):
        time.sleep(0.05)
    nobody: dict[str, Any] = {}
    if run.poll() is None and attack != "netem's host":
        replayed = attack == "old run replayed"
        stolen = "watcher" if attack == "observer's certificate" else "surgeon" if replayed else ""
        proof = dict(credentials(security, stolen)) if stolen else nobody
        where = east if attack == "stranger on east" else west
        if replayed:
            _replay(where, proof, recorded)
        else:
            _forge(where, proof)
    said, _ = run.communicate(timeout=90)
    return _outcome(run_dir, said)


def _outcome(run_dir: Path, said: str) -> dict[str, Any]:
    if not (run_dir / "summary.json").exists():
        return {"verdict": _NOT_REACHED, "said": said}
    summary = json.loads((run_dir / "summary.json").read_text())
    before_the_end = said.partition("This run is")[0]
    live = [
        line for line in before_the_end.splitlines() if "warning" in line and ("refused" in line or "forge" in line)
    ]
    counts = {**summary["refused"], **summary["quarantined"], "rejected": summary["rejected"]["patient"]}
    refused = {kind: n for kind, n in counts.items() if n}
    found = verify((run_dir / AUDIT_FILE).read_bytes().splitlines(keepends=True))
    named = {" ".join(filter(None, (one.name, one.address.rpartition(":")[0]))) or "one of those connected"
             for one in found.entries if one.event == "refused"}  # fmt: skip
    logs = [text for text in summary["problems"] if "did not send" in text]
    verdict = "refused" if refused and not logs else "by the logs" if logs else _NOT_REACHED
    return {
        "verdict": verdict, "refused": refused, "live": live,
        "logs": logs, "named": sorted(named), "audit": found.words, "valid": summary["valid"],
    }  # fmt: skip


def _old_run(kind: str, folder: Path) -> list[Message]:
    """Return the samples of a finished run, as somebody recorded them on the way."""
    size = CODE_BYTES if kind == "signed" else 0
    with (folder / f"{kind}_stranger_on_west" / "surgeon.mcap").open("rb") as file:
        rows = [
            (channel.topic, one.data, Header(one.sequence, one.publish_time).pack() + bytes(size))
            for _, channel, one in make_reader(file).iter_messages(list(_KEYS))
        ]
    return sorted(rows, key=lambda row: Header.unpack(row[2]) or Header(0))


def main(out: Path, kinds: Sequence[str] = KINDS) -> None:
    """Run all attacks and write the table."""
    table: dict[str, Any] = {}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch)
        new_authority(folder / "certs")
        for name in _NAMES:
            issue(folder / "certs", name)
        passwords = folder / "passwords.txt"
        passwords.write_text("".join(f"{name}:{name}-secret\n" for name in _NAMES))
        passwords.chmod(0o600)
        for kind in kinds:
            for attack in ATTACKS:
                recorded = _old_run(kind, folder) if attack == "old run replayed" else []
                for _ in range(3):  # on a busy machine an attack may come after the run's end
                    found = _attack(kind, attack, folder, recorded)
                    if found["verdict"] != _NOT_REACHED:
                        break
                table.setdefault(attack, {})[kind] = found
                out.write_text(json.dumps(table, indent=1) + "\n")
                print(kind, "|", attack, "|", found, flush=True)  # noqa: T201


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2:] or KINDS)
