from typing import Any

import numpy as np
import pytest

from tests.netem.making import KEY, pipeline, scenario
from tis.common.scenario.network.capacity import Rate
from tis.common.streams import Address
from tis.netem.conditions.conditions import Condition, Conditions
from tis.netem.stages.impairment import Impairment, Modulations
from tis.netem.stages.pipeline_draws import Draw

FULL: dict[str, Any] = {
    "loss": {"kind": "bernoulli", "p_loss": 0.2},
    "delay": {"kind": "normal", "mean_ms": 5, "std_ms": 1},
}


def _impairment(**stages: Any) -> Impairment:
    return Impairment(pipeline(**stages), Address(7, "forward", KEY))


def _conditions(*entries: dict[str, Any]) -> Conditions:
    return Conditions.of(scenario(timeline=list(entries)).network, "forward", 7)


def _condition(**change: Any) -> Condition:
    """Return the condition in which ``change`` holds."""
    return _conditions({"at_s": 0, "set": change}).at(0)


CALM = _condition()


def _delays(impairment: Impairment, condition: Condition) -> list[int | str]:
    drawn = [impairment.decide(seq, 0, 256, condition) for seq in range(300)]
    return [draw if isinstance(draw, str) else draw.delay_ns for draw in drawn]


def test_an_outage_takes_every_packet() -> None:
    assert set(_delays(_impairment(**FULL), _condition(outage=True))) == {"outage"}


def test_a_change_replaces_its_stage_and_leaves_the_draws_of_the_others() -> None:
    calm = _delays(_impairment(**FULL), CALM)
    slower = _delays(_impairment(**FULL), _condition(delay={"kind": "constant", "delay_ms": 70}))
    assert [d if d == "loss" else 70_000_000 for d in calm] == slower
    without_loss = _delays(_impairment(**FULL), _condition(loss={"kind": "bernoulli", "p_loss": 0}))
    assert [b for a, b in zip(calm, without_loss, strict=True) if a != "loss"] == [d for d in calm if d != "loss"]
    assert "loss" in calm
    assert "loss" not in without_loss


def test_factors_and_additions_apply_to_what_was_drawn() -> None:
    calm = _delays(_impairment(**FULL), CALM)
    stretched = _delays(_impairment(**FULL), _condition(scale_delay=2.5, add_delay_ms=3))
    expected = [d if isinstance(d, str) else round(d * 2.5) + 3_000_000 for d in calm]
    assert stretched == expected


def test_further_loss_is_independent_of_the_pipelines() -> None:
    impairment, condition = _impairment(**FULL), _condition(add_p_loss=0.5)
    n = 20_000
    lost = sum(impairment.decide(seq, 0, 256, condition) == "loss" for seq in range(n))
    expected = 1 - 0.8 * 0.5
    assert abs(lost / n - expected) < 4 * np.sqrt(expected * (1 - expected) / n)


def test_back_under_the_old_condition_the_old_draws_come() -> None:
    impairment = _impairment(**FULL)
    before = _delays(impairment, CALM)
    _delays(impairment, _condition(delay={"kind": "constant", "delay_ms": 1}))
    assert _delays(impairment, CALM) == before


def test_a_change_gives_a_key_a_rate_and_an_ordering() -> None:
    impairment = _impairment(**FULL)
    condition = _condition(rate={"kbit_s": 100}, ordering="reorder")
    impairment.decide(0, 0, 256, condition)
    assert isinstance(impairment.rate, Rate)
    assert impairment.rate.kbit_s == 100
    assert impairment.ordering == "reorder"
    impairment.decide(0, 0, 256, CALM)
    assert impairment.rate is None
    assert impairment.ordering == "fifo"


@pytest.mark.parametrize("change", [{}, {"scale_delay": 3.0}, {"add_p_loss": 0.3, "add_delay_ms": 1.5}])
def test_one_by_one_as_many_at_once(change: dict[str, Any]) -> None:
    stages = {**FULL, "duplicate": {"p_duplicate": 0.2}, "corrupt": {"p_corrupt": 0.3}}
    condition = _condition(**change)
    seqs = np.arange(5_000)
    n = len(seqs)
    modulations = Modulations(
        condition.changes,
        np.full(n, condition.scale_delay),
        np.full(n, condition.add_delay_ns),
        np.full(n, condition.p_extra_loss),
    )
    many = _impairment(**stages).decide_many(seqs, seqs * 7, 256, modulations)
    one_by_one = _impairment(**stages)
    columns = (column.tolist() for column in many)
    for seq, lost, delay_ns, copy_ns, n_flips in zip(seqs.tolist(), *columns, strict=True):
        drawn = one_by_one.decide(seq, seq * 7_000_000, 256, condition)
        assert drawn == ("loss" if lost else Draw(delay_ns, copy_ns if copy_ns >= 0 else None, n_flips))


def test_live_control_cannot_fill_the_memory() -> None:
    impairment = _impairment(**FULL)
    for i in range(500):
        impairment.decide(0, 0, 256, _condition(delay={"kind": "constant", "delay_ms": i}))
    assert len(impairment._variants) <= 64
