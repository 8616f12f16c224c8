"""Delay, variation and loss of records that one can work out by hand."""

import numpy as np
import pytest

from tis.common.trace import Trace
from tis.deploy.net.probe_command import path_figures, plain_figures

MS = 1_000_000


def trace(delays_ms: list[float | None], every_ms: int = 10) -> Trace:
    sent_ns = np.arange(len(delays_ms), dtype=np.int64) * every_ms * MS
    return Trace("t", sent_ns, np.array([-1 if d is None else round(d * MS) for d in delays_ms], dtype=np.int64))


def test_a_record_by_hand() -> None:
    figures = path_figures(trace([10, None, None, 14, 11, None, 12]))
    assert (figures.n, figures.n_lost, figures.n_runs, figures.longest_run) == (7, 3, 2, 2)
    assert figures.delay_ms["mean"] == pytest.approx(11.75)
    assert (figures.delay_ms["p50"], figures.delay_ms["p99.9"], figures.delay_ms["max"]) == (11, 14, 14)
    assert figures.variation.pdv_p99 == pytest.approx(4)
    # only 14 and 11 are neighbours that both arrived
    assert figures.variation.ipdv_p50 == pytest.approx(3)
    assert figures.variation.ipdv_p99 == pytest.approx(3)
    # RFC 3550, 6.4.1: J += (|D| - J) / 16 over 4, 3, 1
    first = 4 / 16
    second = first + (3 - first) / 16
    assert figures.variation.rtp_jitter == pytest.approx(second + (1 - second) / 16)


def test_overtaking_is_counted() -> None:
    assert path_figures(trace([30, 5, 30, 5, 5])).n_overtaken == 3  # at 30, 15, 50, 35, 45 ms


def test_one_arrival_varies_by_nothing_that_is_known() -> None:
    figures = path_figures(trace([None, 5]))
    assert figures.variation == (0, None, None, None)
    assert figures.delay_ms["mean"] == 5


def test_json_holds_plain_values() -> None:
    plain = plain_figures(path_figures(trace([1, 2, 3])))
    assert plain["losses"]["p_loss"] == 0
    assert plain["variation"]["pdv_p99"] == pytest.approx(2)
