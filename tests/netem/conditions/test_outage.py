from fractions import Fraction
from math import ceil, floor, log, log1p
from typing import Any, get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError
from scipy.stats import kstest

from tests.netem.making import is_out
from tis.common.channels import Direction
from tis.common.scenario.network.conditions import Outages
from tis.common.streams import Stream
from tis.netem.conditions.outage import Outage, outage_share, outages_of
from tis.netem.draws.grid import CELL_NS, cell_of

MS = 1_000_000
NETFI = [((0, 3.0), 8.5, 0.15), ((0, 1.0), 1.0, 1 / 3), ((0, 2.0), 1.0, 0.5)]
POISSON: dict[str, Any] = {"kind": "poisson", "mean_gap_s": 0.02, "mean_s": 0.006}
ALTERNATING: dict[str, Any] = {
    "kind": "alternating", "down": {"low_s": 0, "high_s": 0.007}, "up": {"low_s": 0.0015, "high_s": 0.02},
}  # fmt: skip


def _part(**raw: Any) -> Outages:
    part: Outages = TypeAdapter(Outages).validate_python(raw)
    return part


def _outage(raw: dict[str, Any], direction: Direction = "forward", seed: int = 1, index: int = 0) -> Outage:
    outage = Outage.of(_part(**raw), direction, seed, index)
    assert outage is not None
    return outage


def _edges_ns(outage: Outage, n: int) -> list[int]:
    edges_ns: list[int] = []
    now_ns = 0
    while len(edges_ns) < n:
        now_ns = outage.path.at(cell_of(now_ns)).end * CELL_NS
        edges_ns.append(now_ns)
    return edges_ns


def test_periodic_edges_to_the_nanosecond() -> None:
    outage = _outage({"kind": "periodic", "every_s": 10, "for_s": 0.5})
    assert _edges_ns(outage, 4) == [10_000 * MS, 10_500 * MS, 20_000 * MS, 20_500 * MS]
    assert [is_out(outage, ns) for ns in (0, 10_000 * MS - 1, 10_000 * MS, 10_500 * MS - 1, 10_500 * MS)] == [
        False, False, True, True, False,
    ]  # fmt: skip
    early = _outage({"kind": "periodic", "every_s": 1, "for_s": 0.001, "first_s": 0})
    assert _edges_ns(early, 3) == [1 * MS, 1000 * MS, 1001 * MS]
    assert is_out(early, 0)


def _nearest(seconds: Fraction) -> int:
    return floor(seconds * 1000 + Fraction(1, 2))


@settings(deadline=None, max_examples=60)
@given(st.integers(1001, 30_000), st.data())
def test_periodic_agrees_with_a_table_of_cells(every_us: int, data: st.DataObject) -> None:
    for_us = data.draw(st.integers(1000, every_us - 1))
    first_us = data.draw(st.integers(0, 50_000))
    raw = {"kind": "periodic", "every_s": every_us / 1e6, "for_s": for_us / 1e6, "first_s": first_us / 1e6}
    table = [False] * 300
    for k in range(300):
        begin = Fraction(first_us + k * every_us, 10**6)
        for cell in range(_nearest(begin), min(300, _nearest(begin + Fraction(for_us, 10**6)))):
            table[cell] = True
    outage = _outage(raw)
    for cell, expected in enumerate(table):
        assert is_out(outage, cell * MS) == is_out(outage, cell * MS + MS - 1) == expected
        stretch = outage.path.at(cell)
        assert stretch.begin <= cell < stretch.end
        assert len(set(table[stretch.begin : stretch.end])) == 1


def _table(raw: dict[str, Any], label: str, seed: int, n_cells: int) -> list[bool]:
    """Walk through the uniforms one by one."""
    table: list[bool] = []
    stream = Stream.named(seed, label)
    for i in range(n_cells):
        u = stream.uniform(i)
        if raw["kind"] == "alternating":
            span = raw["down" if i % 2 else "up"]
            low, high = span["low_s"] * 1000, span["high_s"] * 1000
            length = max(1, floor(low + u * (high - low) + 0.5))
        else:
            mean = (raw["mean_s"] if i % 2 else raw["mean_gap_s"]) * 1000
            length = max(1, ceil(log(u) / log1p(-1 / mean)))
            if i % 2 and raw.get("lengths") == "constant":
                length = max(1, floor(mean + 0.5))
        table += [i % 2 == 1] * length
        if len(table) >= n_cells:
            break
    return table[:n_cells]


@pytest.mark.parametrize("raw", [POISSON, POISSON | {"lengths": "constant"}, ALTERNATING])
def test_random_ones_agree_with_one_walk_in_order(raw: dict[str, Any]) -> None:
    n_cells = 60_000  # several chunks
    table = _table(raw, "forward/*/outage/3", 7, n_cells)
    outage = _outage(raw | {"direction": "forward"}, seed=7, index=3)
    assert [outage.path.at(cell).value == 1 for cell in range(n_cells)] == table
    shuffled = _outage(raw | {"direction": "forward"}, seed=7, index=3)
    for cell in (Stream.named(0, "order").uniforms(0, 2000) * n_cells).astype(int).tolist():
        assert is_out(shuffled, cell * MS + 17) == table[cell]
        assert shuffled.path.at(cell) == outage.path.at(cell)


def test_outages_are_memoryless_in_between_and_as_long_as_asked() -> None:
    edges_ns = np.array([0, *_edges_ns(_outage({"kind": "poisson", "mean_gap_s": 2, "mean_s": 0.7}), 20_000)])
    gaps_s, lengths_s = np.diff(edges_ns)[0::2] / 1e9, np.diff(edges_ns)[1::2] / 1e9
    for drawn_s, mean_s in ((gaps_s, 2.0), (lengths_s, 0.7)):
        # a grid of 1 ms shifts the distribution function by less than 1 ms / mean: within KS's noise at this number
        assert kstest(drawn_s, "expon", args=(0, mean_s)).pvalue > 0.001
        assert drawn_s.mean() == pytest.approx(mean_s, rel=4 / np.sqrt(len(drawn_s)))
    assert abs(np.corrcoef(gaps_s, lengths_s)[0, 1]) < 4 / np.sqrt(len(gaps_s))


def test_both_directions_fall_silent_together() -> None:
    raw = ALTERNATING | {"direction": "both"}
    assert _edges_ns(_outage(raw), 100) == _edges_ns(_outage(raw, "feedback"), 100)
    alone = _edges_ns(_outage(ALTERNATING | {"direction": "forward"}), 100)
    other = _edges_ns(_outage(ALTERNATING | {"direction": "feedback"}, "feedback"), 100)
    edges = [_edges_ns(_outage(raw), 100), alone, other, _edges_ns(_outage(raw, seed=2), 100)]
    edges.append(_edges_ns(_outage(raw, index=1), 100))
    assert len({tuple(one) for one in edges}) == 5


def test_each_direction_has_those_that_name_it() -> None:
    parts = [_part(**POISSON, direction=direction) for direction in ("forward", "feedback", "both")]
    assert [len(outages_of(parts, direction, 1)) for direction in get_args(Direction)] == [2, 2]
    with_more = outages_of([*parts, _part(**ALTERNATING)], "forward", 1)
    for before, after in zip(outages_of(parts, "forward", 1), with_more, strict=False):
        assert _edges_ns(before, 50) == _edges_ns(after, 50)


@pytest.mark.parametrize(("down", "up_s", "share"), NETFI)
def test_published_connection_losses_have_their_real_shares(
    down: tuple[float, float], up_s: float, share: float
) -> None:
    part = _part(
        kind="alternating",
        down={"low_s": down[0], "high_s": down[1]},
        up={"low_s": up_s, "high_s": up_s},
    )
    assert outage_share(part) == pytest.approx(share, abs=1e-6)  # a length of 0 becomes 1 ms


@pytest.mark.parametrize(
    "raw",
    [
        POISSON,
        POISSON | {"lengths": "constant", "mean_s": 0.0034},
        ALTERNATING,
        {"kind": "alternating", "down": {"low_s": 0, "high_s": 0.001}, "up": {"low_s": 0.0014, "high_s": 0.0044}},
    ],
)
def test_share_of_a_long_simulation(raw: dict[str, Any]) -> None:
    outage = _outage(raw)
    edges_ns = np.array([0, *_edges_ns(outage, 40_000)])
    down_ns = np.diff(edges_ns)[1::2]
    period_ns = np.diff(edges_ns[0::2])
    share = down_ns.sum() / period_ns.sum()
    residual = down_ns - share * period_ns
    error = residual.std() / np.sqrt(len(residual)) / period_ns.mean()
    assert error < 0.01 * share
    assert outage_share(_part(**raw)) == pytest.approx(share, abs=4 * error)


@pytest.mark.parametrize(
    ("every_s", "for_s", "first_s"),
    [
        (0.0104, 0.0033, 0.0),
        (0.01, 0.0014, 0.0004),
        (0.01, 0.0014, 0.0),
        (0.0015, 0.0012, 0.001),
        (0.0333, 0.0017, 7),
    ],
)
def test_share_of_periodic_ones_counted_in_cells(every_s: float, for_s: float, first_s: float) -> None:
    raw = {"kind": "periodic", "every_s": every_s, "for_s": for_s, "first_s": first_s}
    outage = _outage(raw)
    begin = 8000
    superperiod = round(every_s * 1e4)  # ten periods of these are whole ms
    counted = sum(outage.path.at(cell).value for cell in range(begin, begin + superperiod))
    assert outage_share(_part(**raw)) == pytest.approx(counted / superperiod, abs=1e-12)


@pytest.mark.parametrize(
    "raw",
    [
        {"kind": "periodic", "every_s": 1, "for_s": 1},
        {"kind": "periodic", "every_s": 1, "for_s": 0.0009},
        {"kind": "poisson", "mean_gap_s": 1, "mean_s": 0},
        {"kind": "poisson", "mean_gap_s": 1e9, "mean_s": 1},
        {"kind": "alternating", "down": {"low_s": 2, "high_s": 1}, "up": {"low_s": 1, "high_s": 1}},
        {"kind": "periodic", "every_s": 1, "for_s": 0.5, "first_s": 1e300},
    ],
)
def test_what_makes_no_sense_on_the_grid_is_refused(raw: dict[str, Any]) -> None:
    with pytest.raises(ValidationError):
        _part(**raw)
