"""Choice of the methods, and the extent of what is computed for each."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

from tis.common.errors import Fault, InputError
from tis.common.scenario.estimator_names import fault_of, is_built_in

COMMAND: Final = "tis paper --methods"

_USUAL: Final = (
    "hold",
    "moesp_kf",
    "paper",
    "arx_kf",
    "innovations_kf",
    "direct_ls",
    "transformer",
    "informer",
    "cnn",
    "gpr",
    "srlsmf",
    "srlsmf_l1",
    "drmf",
)
DEFAULT_METHODS: Final = tuple(name for name in _USUAL if is_built_in(name))
"""The yardstick, the linear estimators, and those of the paper's other columns, as far as there are any."""


@dataclass(frozen=True)
class Extent:
    """How much is computed for each method; ``n_people`` None: all trials of all people for the accuracy."""

    delays_ms: tuple[float, ...] = (33, 100, 200, 500, 1000)
    losses_pct: tuple[float, ...] = (0, 1, 5, 10, 20, 30)
    noises_mm: tuple[float, ...] = (0, 0.5, 1, 2, 5)
    n_training_trials: tuple[int, ...] = (1, 2, 4, 8)
    block_rows: tuple[int, ...] = (5, 10, 20, 40)
    n_seeds: int = 3
    n_people: int | None = None
    duration_s: float | None = None
    n_rounds: int = 5
    n_ticks: int = 900


WHOLE: Final = Extent()
QUICK: Final = Extent(
    delays_ms=(100, 500),
    losses_pct=(0, 20),
    noises_mm=(0, 2),
    n_training_trials=(1,),
    block_rows=(5, 10),
    n_seeds=1,
    n_people=2,
    duration_s=12.0,
    n_rounds=2,
    n_ticks=300,
)
DELAY_MS: Final = 100.0
"""Constant delay at which all but accuracy and reliability is measured."""
MEAN_BURST: Final = 8.0
"""Mean length of the bursts of loss, in messages: a quarter of a second at 30 Hz."""
RELIABILITY_NETWORK: Final = (
    "network={forward: {loss: {kind: burst, p_loss: 0.05, mean_burst: 4}, delay: {kind: uniform, low_ms: 50, "
    "high_ms: 150}, ordering: reorder}}"
)


def methods_of(text: str | None) -> tuple[str, ...]:
    """Return the methods of a list separated by commas, `hold` first; `DEFAULT_METHODS` for None.

    Raises `InputError` with all faults. Estimators of users are refused: which models they need is unknown.
    """
    names: Sequence[str] = DEFAULT_METHODS if text is None else [name.strip() for name in text.split(",")]
    faults = [
        Fault(COMMAND, "--estimators", fault_of(name) or "must be a built-in estimator", name)
        for name in names
        if not is_built_in(name)
    ]
    if faults:
        raise InputError(faults)
    return tuple(dict.fromkeys(("hold", *names)))
