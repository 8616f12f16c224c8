"""Estimators on the same arrivals, over trials, seeds and networks.

`compare` is the entry point for notebooks and scripts; the command is `tis compare`:

>>> from tis.deploy.compare import Study, compare
>>> axes = {"network.forward.delay.delay_ms": [33, 100]}
>>> result = compare(Study(scenario="default", axes=axes, seeds=4))  # doctest: +SKIP
>>> result.pooled[0]["ratio_to_hold"]  # doctest: +SKIP
"""

from tis.deploy.compare.comparison import Comparison, compare
from tis.deploy.compare.study import Study

__all__ = ["Comparison", "Study", "compare"]
