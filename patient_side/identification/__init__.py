"""From recorded movements to models of an arm; `identify` is the entry.

Where to look:

- the rows: `dataset`, `trials`, `signals`;
- linear models of arm and command: `methods` by name, `subspace` with `moesp`, `pi_moesp`, `n4sid`, `cva`; `arx`;
  `output_error` for B, D and x0, `order`, `noise`, `validation`; `fit_subspace` and `fit_arx` put these together;
- the movement by itself: `fit_innovations` on `stochastic_moesp`, `fit_autoregression`, `direct_ls`, `fit_reach`;
- how a command continues: `forecast`;
- as the paper has it: `fit_moesp_paper`; for comparison: `fit_narx`;
- model files: `model_io`, `model_schema`.
"""
