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
"""
