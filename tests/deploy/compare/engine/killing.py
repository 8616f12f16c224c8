"""An own estimator that ends the process in which it runs, once: where a file says so."""

KILLING = """
import os, signal
from pathlib import Path
from my_filter import AlphaBeta

class Once(AlphaBeta):
    def step(self, state, playout, now_ns):
        if playout.arm.newest == 50:
            try:
                Path("kill").unlink()
            except FileNotFoundError:
                pass
            else:
                os.kill(os.getpid(), signal.SIGKILL)
        return super().step(state, playout, now_ns)
"""
