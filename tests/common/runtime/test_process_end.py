"""Ends of real processes: exit code, outputs and handlers are those of an ordinary end."""

import subprocess
import sys

import pytest

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
