"""Training of the learned methods: what a patient never needs during a run.

Where to look:

- what they learn from: `arrivals` (losses and delays that are drawn), `examples` (rows as a patient would see them);
- `fit_network` on `gradient_steps` (JAX and Optax); `fit_gpr` and `fit_srlsmf` (on `low_rank_plus_sparse`), whose
  scales `process_scales` finds (scikit-learn);
- `calibration` of stated covariances on held-out errors;
- the entry point, which adds the models to those of `tis.patient_side.identification`: `train`.

JAX, Optax and scikit-learn are the extra ``learned``.
"""
