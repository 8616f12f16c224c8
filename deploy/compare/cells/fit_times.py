"""CPU time of identification by estimator, measured while the models of all estimators are identified once.

An estimator alone needs the chosen model and the model beside it that is its own; the parts are measured and added,
so that no model is identified a second time for its time.
"""

import time
from collections import defaultdict
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Final

_MODEL_OF: Final = {"paper_as_printed": "paper", "adaptive_kf": "innovations_kf"}
"""Estimators that may share the model fitted for another one."""


class FitTimes:
    """CPU time of the process in the fits for single estimators: networks are trained by several threads."""

    def __init__(self) -> None:
        self.fits_s: defaultdict[str, float] = defaultdict(float)

    @contextmanager
    def stage(self, name: str) -> Iterator[None]:
        """Add the time of the context to the estimator's, also where the fit fails."""
        begun_s = time.process_time()
        try:
            yield
        finally:
            self.fits_s[name] += time.process_time() - begun_s

    def alone_s(self, name: str, all_s: float) -> float:
        """Return the time for one estimator alone, of ``all_s`` that the identification took for all of them."""
        own = name if name in self.fits_s else _MODEL_OF.get(name, name)
        return all_s - sum(self.fits_s.values()) + self.fits_s.get(own, 0.0)
