"""Kalman filters of an arm, in source time: the estimators run on these.

- the Kalman update itself: `kalman_update`;
- the filter of `moesp_kf`, `n4sid_kf` and `arx_kf`: `kalman` on the augmented model, `input_path` for the command;
- the filter of `innovations_kf`: `innovations_states` and `innovations_filter` (matrices, gain, update), `unbroken`
  and `uncertainty` (covariances computed once), `checkpoint_ring` and `replay_window` (late samples), `stand_in`
  (commands in place of lost samples), `lag_forecast` and `correction` (the forecast), `activity` (the scale of its
  covariance);
- robust factorisation of a Hankel matrix with missing entries: `hankel_completion` by the steps of
  `robust_factorisation`;
- Algorithm 1 of the paper on arrays: `paper_kalman`.
"""
