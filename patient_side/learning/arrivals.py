"""Drawn arrivals of a trial's rows: the networks that learned methods are trained on.

A fifth of the trials each: clean; losses one by one; losses in bursts (Gilbert-Elliott); delays of a few samples;
delays of up to five seconds, as in the paper's worst row. Delays are drawn for each row alone, so rows overtake one
another.
"""

from typing import Final

import numpy as np

from common.streams import Stream
from patient_side.learned_model import Floats

TICK_PHASE: Final = 0.06
"""Instant of a tick after its sample, in samples: 2 ms at 30 Hz."""
N_KINDS: Final = 5
LOST: Final = np.inf

_N_SETTINGS: Final = 4
_ALSO_LOST: Final = 0.02
"""Share of the rows that is lost where delays vary."""


def draw_arrivals(kind: int, n_rows: int, stream: Stream) -> Floats:
    """Return the instants (N,) at which rows arrive, in samples; infinite for lost ones.

    ``kind`` is 0 to 4, in the order above. Oracles in test_arrivals: mean loss, length of bursts, range of delays.
    """
    first, second, *_ = stream.uniforms(0, _N_SETTINGS).tolist()
    drawn = stream.uniforms(_N_SETTINGS, n_rows)
    delay = np.full(n_rows, TICK_PHASE)
    if kind == 1:
        delay[drawn < 0.02 + 0.48 * first] = LOST
    elif kind == 2:
        delay[_bursts(drawn, p_loss=0.02 + 0.28 * first, mean_burst=2.0 + 10.0 * second)] = LOST
    elif kind >= 3:
        shortest, spread = (3.0 * first, 1.0 + 9.0 * second) if kind == 3 else (10.0 * first, 10.0 + 140.0 * second)
        delay = shortest + spread * drawn
        delay[stream.uniforms(_N_SETTINGS + n_rows, n_rows) < _ALSO_LOST] = LOST
    return np.asarray(np.arange(n_rows) + delay)


def _bursts(drawn: Floats, p_loss: float, mean_burst: float) -> np.ndarray[tuple[int], np.dtype[np.bool_]]:
    """Return the rows (N,) that a Gilbert-Elliott channel loses."""
    p_end = 1.0 / mean_burst
    p_begin = p_end * p_loss / (1.0 - p_loss)
    lost, is_bad = np.zeros(len(drawn), dtype=np.bool_), False
    for i, u in enumerate(drawn.tolist()):
        is_bad = u >= p_end if is_bad else u < p_begin
        lost[i] = is_bad
    return lost
