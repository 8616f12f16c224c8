"""Standard output while Zenoh's log is read: in a process of its own, as it is taken over for good."""

import subprocess
import sys
from pathlib import Path

import pytest

from tis.common.runtime.ports import free_endpoints

_ROOT = Path(__file__).resolve().parents[3]
_PROGRAM = """
import sys
import zenoh
from tis.common.runtime.zenoh_log import ROUTER_LEVELS, RefusalCounter, ZenohLog
from tis.common.runtime.zenoh_session import ZenohOptions, configure

first = []
counter = RefusalCounter(lambda kind, line: first.append(kind))
with ZenohLog(ROUTER_LEVELS, counter.take):
    print("ours", flush=True)
    users, endpoint = sys.argv[1:]
    proof = {"transport/auth/usrpwd": {"user": "netem", "password": "a", "dictionary_file": users}}
    with zenoh.open(configure("router", ZenohOptions(listen=[endpoint], credentials=proof))):
        for _ in range(2):
            try:
                zenoh.open(configure("client", ZenohOptions(connect=[endpoint])))
            except zenoh.ZError:
                print("refused", flush=True)
print("after", sorted(set(first)), {name: n > 1 for name, n in counter.counters().items()}, flush=True)
"""


@pytest.mark.live
@pytest.mark.parametrize("asked", [None, "warn"])
def test_what_we_print_and_what_the_user_asked_for_pass(tmp_path: Path, asked: str | None) -> None:
    users, (endpoint, _) = tmp_path / "users", free_endpoints()
    users.write_text("netem:a\n")
    found = subprocess.run(
        [sys.executable, "-c", _PROGRAM, str(users), endpoint],
        cwd=_ROOT, capture_output=True, text=True, check=True,
        env={"PATH": "", **({} if asked is None else {"RUST_LOG": asked})},
    )  # fmt: skip
    ours = [line for line in found.stdout.splitlines() if line[:1].isalpha()]
    assert ours == ["ours", "refused", "refused", "after ['no_password'] {'refused.no_password': True}"]
    assert ("Unable to connect" in found.stdout) == (asked is not None)
