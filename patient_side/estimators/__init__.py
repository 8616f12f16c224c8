"""Estimators of the arm's present position: one protocol.

Where to look:

- the interface: `protocol`; rows by name: `tis.common.estimators`, built by `builders`; those of users: `guarded`;
- in `simple`: hold (the reference of all scores), hold_last_arrived, velocity, damped_velocity, static_gain;
- Kalman filters: `moesp_kf` with `n4sid_kf` and `arx_kf`, the same filter on other models, `innovations_kf` on the
  movement of arm or command, and `adaptive_kf`, the default, which tracks that one's scales; their updates live in
  `tis.patient_side.filters`, see `filters.kalman`;
- a regression for each horizon: `direct_ls`;
- a completed Hankel matrix: `drmf`, on `filters.hankel_completion`;
- the paper's Algorithm 1: `paper_as_printed`, `paper` (its update repaired).

Those that only the studies judge (`tis.common.estimators`) are factories of this package for a scenario, by
``module:factory``: ``tis.patient_side.estimators:direct_ls``.
"""

from functools import partial
from typing import Any


def __getattr__(name: str) -> Any:
    """Return the factory of a method of the studies."""
    from tis.common.estimators import ESTIMATORS

    if name not in ESTIMATORS or not ESTIMATORS[name].judged_by:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from tis.patient_side.estimators.builders import build_estimator

    return partial(build_estimator, name)
