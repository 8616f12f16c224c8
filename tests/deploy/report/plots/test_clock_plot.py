from typing import Any

import numpy as np
from bokeh.models import ColumnDataSource
from bokeh.models.renderers import GlyphRenderer
from bokeh.plotting import figure
from msgspec import to_builtins

from tests.common.clocks.wrong_clock import S
from tests.deploy.logs.read.test_clocks import asked, compared
from tis.common.messages import Message
from tis.common.node import Record
from tis.deploy.logs.read.clocks import RunClocks, run_clocks
from tis.deploy.report.plots.clocks import clock_figure


def _rows(*records: Record) -> dict[str, list[dict[str, Any]]]:
    rows: dict[str, list[dict[str, Any]]] = {}
    for record in records:
        assert isinstance(record.data, Message)
        rows.setdefault(record.topic, []).append(to_builtins(record.data))
    return rows


def test_a_dot_is_an_exchange_and_the_band_what_they_leave_open() -> None:
    """Sixty exchanges of 40 us, 5 ms ahead; one took 1 ms longer on the way back: 500 us off the line."""
    rows = _rows(compared("s"), *(asked(i * 1000, 5) for i in range(60)), asked(30_500, 5, longer_ms=1))
    clocks = run_clocks({"surgeon": rows, "netem": {}}, {"surgeon": 60 * S, "netem": 60 * S}, "live")
    drawn = clock_figure(clocks)
    assert drawn is not None
    [plot] = drawn.plots
    assert isinstance(plot, figure)
    band, dots = (r.data_source for r in plot.renderers if isinstance(r, GlyphRenderer))
    assert isinstance(band, ColumnDataSource)
    assert isinstance(dots, ColumnDataSource)
    assert len(dots.data["at"]) == 61
    assert np.isclose(np.min(dots.data["off"]), -500, atol=1)
    assert np.count_nonzero(np.abs(dots.data["off"]) < 1) == 60
    assert 20 <= np.min(band.data["high"]) <= np.max(band.data["high"]) < 40
    assert "surgeon: " in drawn.caption


def test_one_clock_has_nothing_to_draw() -> None:
    assert clock_figure(RunClocks()) is None
    rows = _rows(compared("n", shared=True))
    assert clock_figure(run_clocks({"surgeon": rows, "patient": {}}, {"surgeon": 0, "patient": 0}, "live")) is None
