"""Summary, verdicts and reports of a run.

`load` is the entry point for notebooks and scripts:

>>> from tis.deploy.report import load
>>> run = load("runs/default_20260101_120000")  # doctest: +SKIP
>>> run.error_mm("moesp_kf").mean()  # doctest: +SKIP
"""

from tis.deploy.report.run_data import OUTCOMES, Run, load

__all__ = ["OUTCOMES", "Run", "load"]
