"""The figure of delays: what its caption says is drawn."""

from typing import Any, cast

import numpy as np
import pytest

from tis.deploy.report.plots.distributions import delay_cdf


class _Constant:
    """A request for 50 ms."""

    def quantiles_ms(self, shares: Any) -> list[float]:
        return [50.0] * len(shares)


class _Columns:
    decided_ms = np.full(9, 50.0)
    realised_ms = np.full(9, 50.1)


@pytest.mark.parametrize("request_of_all", [_Constant(), None])
def test_a_requested_distribution_is_told_where_it_is_drawn(request_of_all: Any) -> None:
    figure = delay_cdf({"forward": cast("Any", _Columns())}, {"forward": request_of_all}, varies=False)
    assert figure is not None
    is_drawn = any("requested" in key.name for key in figure.keys)
    assert is_drawn == (request_of_all is not None)
    assert ("requested (dashed)" in figure.caption) == is_drawn
    assert ("no single distribution was requested" in figure.caption) != is_drawn
