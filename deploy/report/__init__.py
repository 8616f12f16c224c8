"""What a run was: read back, summed up, shown.

`load` is the entry for notebooks and scripts:

>>> from deploy.report import load
>>> run = load("runs/default_20260101_120000")  # doctest: +SKIP
>>> run.error_mm("moesp_kf").mean()  # doctest: +SKIP
"""

# The function takes the submodule's place as an attribute, which holds as the submodule is imported before.
from deploy.report.run_data import OUTCOMES, Ages, Messages, Run, Samples, Ticks, load

__all__ = ["OUTCOMES", "Ages", "Messages", "Run", "Samples", "Ticks", "load"]
