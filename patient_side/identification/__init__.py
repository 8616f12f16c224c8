"""Identification: models of an arm from recorded movements; `identify` is the entry.

Where to look:

- training rows: `dataset`, `trials`, `signals`;
- linear models of arm and command: `methods` by name, `subspace` with `moesp`, `pi_moesp`, `n4sid`, `cva`; `arx`;
  `output_error` for B, D and x0, `order`, `noise`, `validation`; `fit_subspace` and `fit_arx` combine these;
- the arm's own movement: `fit_innovations` on `stochastic_moesp` with `fit_correction`, `fit_autoregression`,
  `direct_ls`, `fit_drmf` on `arrival_draws`;
- the forecast of a command: `forecast`;
- the paper's method: `fit_moesp_paper`; for comparison: `fit_narx`;
- model files: `model_file`.
"""
