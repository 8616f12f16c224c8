"""The command of a run as its logs show it: as it was typed, but for secrets."""

import os
import shlex
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

import tis
from tis.common.runtime.process import Interrupt, child_environment, command_line, repeatable

SECRET = "Tr0ub4dor"
PASSWORD = "transport/auth/usrpwd/password"


@pytest.mark.parametrize(
    ("typed", "shown"),
    [
        ("run default --set seed=3", "run default --set seed=3"),
        (f"run default --cfg {PASSWORD}:{SECRET}", f"run default --cfg {PASSWORD}:..."),
        (f"run default --cfg={PASSWORD}:{SECRET}", f"run default --cfg={PASSWORD}:..."),
        (f"netem --cfg 'transport/auth/usrpwd:{{user: \"a\", password: \"{SECRET}\"}}' -l tcp/0.0.0.0:1",
         "netem --cfg transport/auth/usrpwd:... -l tcp/0.0.0.0:1"),
        (f"netem --cfg {SECRET}", "netem --cfg ..."),
        (f"netem -e 'tls/h:1#root_ca_certificate_file=ca.pem;connect_private_key_base64={SECRET}'",
         "netem -e 'tls/h:1#root_ca_certificate_file=ca.pem;connect_private_key_base64=...'"),
        (f"netem --connect='tls/h:1#listen_private_key_base64={SECRET}'",
         "netem --connect=tls/h:1#listen_private_key_base64=..."),
        ("netem --cfg", "netem --cfg"),
    ],
)  # fmt: skip
def test_secrets_are_left_out_and_all_else_stays(typed: str, shown: str) -> None:
    found = command_line(shlex.split(typed))
    assert SECRET not in found
    assert shlex.split(found) == ["tis", *shlex.split(shown)]


NAMES = ("common", "surgeon_side", "netem", "patient_side", "deploy")


def said(folder: Path, *words: str) -> "subprocess.CompletedProcess[str]":
    return subprocess.run(
        [sys.executable, *words], cwd=folder, env=child_environment(), capture_output=True, text=True, check=False
    )


def test_a_child_in_another_folder_imports_the_same_package(tmp_path: Path) -> None:
    printed = said(tmp_path, "-c", "import tis; print(tis.__file__)").stdout.strip()
    assert Path(printed).samefile(tis.__file__)


@pytest.mark.parametrize("words", [("-m", "tis.common"), ("-c", "import tis.common")])
def test_a_package_of_the_same_name_in_the_current_folder_is_not_imported(
    tmp_path: Path, words: tuple[str, ...]
) -> None:
    (tmp_path / "tis").mkdir()
    (tmp_path / "tis" / "__init__.py").write_text("raise ImportError('not the testbed')\n")
    assert "not the testbed" not in said(tmp_path, *words).stderr


@pytest.mark.parametrize("name", NAMES)
def test_the_users_package_of_a_common_name_is_imported_by_it(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, name: str
) -> None:
    (tmp_path / name).mkdir()
    (tmp_path / name / "__init__.py").write_text("print('own')\n")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    assert said(tmp_path, "-c", f"import tis.{name}, {name}").stdout == "own\n"


@pytest.mark.parametrize("name", NAMES)
def test_an_old_name_is_refused_with_the_new_one(name: str) -> None:
    root = Path(tis.__file__).parents[1]
    done = said(root, "-c", f"import sys; sys.path.insert(0, '.'); import {name}")
    assert done.returncode == 1
    assert f"{name} has become tis.{name}" in done.stderr


_WORDS = """
import os, signal, sys
from tis.common.runtime.process import Interrupt
interrupt = Interrupt()
with interrupt.installed():
    os.kill(os.getpid(), signal.SIGHUP)
os.kill(os.getpid(), signal.SIGHUP)
print(interrupt.requested)
"""


@pytest.fixture(autouse=True)
def no_nohup() -> Iterator[None]:
    """Let SIGHUP end a process as usual, also where `nohup` has started the tests."""
    before = signal.signal(signal.SIGHUP, signal.SIG_DFL)
    yield
    signal.signal(signal.SIGHUP, before)


def test_sigint_ends_what_a_script_has_put_in_the_background() -> None:
    """A shell script starts it with SIGINT ignored."""
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        with Interrupt().installed():
            assert signal.getsignal(signal.SIGINT) is not signal.SIG_IGN
        assert signal.getsignal(signal.SIGINT) is signal.SIG_IGN
    finally:
        signal.signal(signal.SIGINT, before)


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
def test_a_signal_is_a_flag_and_wakes_who_waits(number: signal.Signals) -> None:
    interrupt, woken = Interrupt(), []
    interrupt.wakers.append(lambda: woken.append(number))
    before = signal.getsignal(number)
    with interrupt.installed():
        assert not interrupt.requested
        os.kill(os.getpid(), number)
        assert interrupt.requested
    after = signal.signal(number, before)
    assert woken == [number]
    assert after == (signal.SIG_IGN if number == signal.SIGHUP else before)


@pytest.mark.parametrize(("head", "requested"), [([], "True"), (["nohup"], "False")])
def test_a_second_hangup_ends_nothing_and_nohup_ignores_all(head: list[str], requested: str) -> None:
    done = subprocess.run(
        [*head, sys.executable, "-c", _WORDS], stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False
    )
    assert (done.returncode, done.stdout.strip()) == (0, requested), done.stderr


_PROGRAM = """\
import atexit, sys, threading, time
from concurrent.futures import ThreadPoolExecutor
from tis.common.runtime.process import run_to_end

class Witness:
    def __del__(self):
        print("finalised", flush=True)

witness = Witness()
atexit.register(lambda: print("handler"))

def main():
    pool = ThreadPoolExecutor(1)  # left open, with a thread that waits for work
    pool.submit(int).result()
    threading.Thread(target=lambda: (time.sleep(0.2), print("thread"))).start()
    {load}
    sys.exit({code})

run_to_end(main)
"""


@pytest.mark.parametrize(("code", "ends"), [("4", 4), ("None", 0), ("'a reason'", 1)])
@pytest.mark.parametrize("load", ["pass", "import zenoh"])
def test_an_end_is_an_ordinary_one_but_for_the_interpreters(load: str, code: str, ends: int) -> None:
    program = _PROGRAM.format(load=load, code=code)
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False, timeout=60)
    said = ["thread", "handler", *(["finalised"] if load == "pass" else [])]
    assert (done.returncode, done.stdout.split()) == (ends, said)
    assert done.stderr == ("a reason\n" if ends == 1 else "")


@pytest.mark.parametrize("run_dir", [["--run-dir", "a/b"], ["--run-dir", "it's a b"], ["--run-dir=a b"]])
def test_a_command_is_repeated_without_its_folder(run_dir: list[str]) -> None:
    typed = shlex.join(["tis", "twin", "default", *run_dir, "--seed", "3"])
    assert repeatable(typed) == "tis twin default --seed 3"
    assert repeatable(typed, " --log") == "tis twin default --log --seed 3"
    assert repeatable("tis twin default") == "tis twin default"


_STARTS_A_CHILD = """\
import subprocess, sys, threading, time
from tis.common.runtime.process import child_environment

CHILD = "from tis.common.runtime.process import follow_parent as f; import time; f(); print(1, flush=True)"
CHILD += "; time.sleep(60)"

def start():
    child = subprocess.Popen([sys.executable, "-c", CHILD], stdout=subprocess.PIPE, env=child_environment())
    child.stdout.readline()
    print(child.pid, flush=True)

starter = threading.Thread(target=start)
starter.start()
starter.join()
time.sleep(60)
"""


def runs(pid: int) -> bool:
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] not in "ZX"
    except OSError:
        return False


@pytest.mark.parametrize("is_between", [False, True])
def test_a_child_ends_with_its_killed_parent_and_not_with_the_thread_that_started_it(is_between: bool) -> None:
    """``is_between``: the parent has the environment of a child of another process of ours."""
    with subprocess.Popen(
        [sys.executable, "-c", _STARTS_A_CHILD],
        stdout=subprocess.PIPE,
        text=True,
        env=child_environment() if is_between else None,
    ) as parent:
        assert parent.stdout is not None
        child = int(parent.stdout.readline())
        time.sleep(0.2)
        assert runs(child)  # although the thread that started it is over
        parent.kill()
        parent.wait()
        ended = until(lambda: not runs(child))
    if not ended:
        os.kill(child, signal.SIGKILL)
    assert ended


def test_a_child_whose_parent_is_gone_already_ends_at_once() -> None:
    """Neither a number without a process nor one that another process has taken since counts as the parent."""
    gone = subprocess.run([sys.executable, "-c", "import os; print(os.getpid())"], capture_output=True, check=True)
    for parent in (f"{int(gone.stdout)}:1", f"{os.getpid()}:1"):
        words = "from tis.common.runtime.process import follow_parent as f; import time; f(); time.sleep(60)"
        environment = {**os.environ, "TIS_PARENT": parent}
        done = subprocess.run([sys.executable, "-c", words], env=environment, check=False, timeout=30)
        assert done.returncode == -signal.SIGTERM


def until(there: Callable[[], bool]) -> bool:
    """Wait for something, for 30 s at most; tell whether it came."""
    end_s = time.monotonic() + 30
    while not there() and time.monotonic() < end_s:
        time.sleep(0.02)
    return there()
