"""Identification: models of an arm from recorded movements; `identify` is the entry.

Where to look:

- training rows: `dataset`, `trials`; arguments and result of a linear method: `linear_model`;
- linear models of arm and command: `subspace_methods` (MOESP, past-input MOESP, N4SID, CVA) on `subspace` and
  `hankel`; `arx`; `output_error` for B, D and x0, `order`, `noise`, `validation`;
- the arm's own movement: `fit_innovations` on `stochastic_moesp` with `fit_correction` and `fit_heads`, `direct_ls`,
  `fit_drmf`;
- the forecast of a command, and the response of an arm to its command: `forecast`;
- the paper's method: `moesp_paper`; for comparison: `narx`;
- as a library, `from tis import identify`: `system_identification`, with `identified_system`, `input_delay` and
  `residual_tests`;
- model files: `model_file`.
"""
