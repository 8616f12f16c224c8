"""Kalman filters of an arm, in source time: the estimators run on these.

- the filter of `moesp_kf`, `n4sid_kf` and `arx_kf`: `kalman`, with the Kalman update itself, on the augmented model,
  `input_path` for the command;
- the filter of `innovations_kf`: `innovations_filter` (states, matrices, gain, update), `recent_past` (further
  states, an arm's response among them), `unbroken` (covariances computed once), `replay` (late samples), `stand_in`
  (commands in place of lost samples), `lag_forecast` and `correction` with its `heads` (the forecast), `activity`
  (the scale of its covariance);
- robust factorisation of a Hankel matrix with missing entries: `hankel_completion`;
- Algorithm 1 of the paper on arrays: `paper_kalman`.
"""
