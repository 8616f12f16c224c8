from typing import Any

import pytest

from tests.netem.making import scenario
from tis.common.channels import Direction
from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.netem.link.rules import RuleTable, compile_rules


def _rule(key: str, delay_ms: float, direction: str = "forward") -> dict[str, Any]:
    return {"key": key, "direction": direction, "pipeline": _delayed(delay_ms)}


def _delayed(delay_ms: float) -> dict[str, Any]:
    return {"delay": {"kind": "constant", "delay_ms": delay_ms}}


def _compile(made: Scenario, where: str) -> dict[Direction, RuleTable]:
    return compile_rules(made.network, where, [f"{made.session}/**"], made.generated_rules())


def _delay_ms(table: Any, key: str) -> float | str | None:
    """Return by its delay which pipeline ``key`` gets; None for the clean one."""
    assigned = table.assign(key)
    if assigned is None:
        return "refused"
    pipeline = assigned.pipeline
    return None if pipeline.delay is None else float(pipeline.delay.delay_ms)


def test_the_session_has_a_default_for_each_direction() -> None:
    tables = _compile(scenario(forward=_delayed(1), feedback=_delayed(2)), "x")
    assert _delay_ms(tables["forward"], "tis/MTML/measured_cp") == 1
    assert _delay_ms(tables["feedback"], "tis/PSM2/estimated_cp") == 2


@pytest.mark.parametrize(("unmatched", "expected"), [("refuse", "refused"), ("pass", None)])
def test_keys_outside_the_session(unmatched: str, expected: str | None) -> None:
    table = _compile(scenario(forward=_delayed(1), unmatched=unmatched), "x")["forward"]
    assert _delay_ms(table, "camera/image") == expected
    assert _delay_ms(table, "tisane/MTML/measured_cp") == expected
    assert _delay_ms(table, "a//b") == "refused"  # not a key in Zenoh
    assert _delay_ms(table, "tis/PSM2/setpoint_cp") == 1


@pytest.mark.parametrize("backwards", [False, True])
def test_the_most_specific_rule_wins_wherever_it_stands(backwards: bool) -> None:
    rules = [
        _rule("**", 1),
        _rule("*/MTML/**", 2),
        _rule("tis/MTML/*", 3),
        _rule("tis/MTML/measured_cp", 4),
        _rule("camera/$*left", 5),
        _rule("tis/MTML/measured_cp", 6, "feedback"),
    ]
    tables = _compile(scenario(rules=rules[::-1] if backwards else rules), "x")
    expected = {
        "tis/MTML/measured_cp": 4,
        "tis/MTML/gripper": 3,
        "tis/MTML/deep/er": 2,
        "other/MTML": 2,
        "tis/PSM2/setpoint_cp": 1,
        "camera/left": 5,
        "camera/right": 1,
        "camera": 1,
    }
    assert {key: _delay_ms(tables["forward"], key) for key in expected} == expected
    assert _delay_ms(tables["feedback"], "tis/MTML/measured_cp") == 6


def test_a_rule_for_the_whole_session_replaces_its_default() -> None:
    table = _compile(scenario(forward=_delayed(1), rules=[_rule("tis/**", 9)]), "x")["forward"]
    assert _delay_ms(table, "tis/MTML/measured_cp") == 9


def test_observer_passes_the_commands_clean_and_nothing_else() -> None:
    made = scenario("observer", forward=_delayed(1), rules=[_rule("*/MTML/measured_cp", 2)])
    table = _compile(made, "x")["forward"]
    assert _delay_ms(table, "tis/MTML/measured_cp") is None
    assert _delay_ms(table, "tis/MTMR/measured_cp") is None
    assert _delay_ms(table, "tis/PSM2/setpoint_cp") == 1
    assert _delay_ms(table, "other/MTML/measured_cp") == 2


def test_all_ties_at_once_each_with_its_field() -> None:
    rules = [
        _rule("tis/*/measured_cp", 1),
        _rule("tis/x", 2),
        _rule("tis/MTML/*", 3),  # ties with rule 0: tis/MTML/measured_cp is in both
        _rule("tis/MTML/*", 4, "feedback"),
        _rule("a/**/*", 5),
        _rule("a/*/**", 6),  # what the rule before it means
    ]
    with pytest.raises(InputError) as raised:
        _compile(scenario(rules=rules), "my.yaml")
    assert str(raised.value).splitlines() == [
        "my.yaml: network.rules.2.key: shares keys with, but is no special case of, "
        "network.rules.0.key, 'tis/*/measured_cp' (got 'tis/MTML/*')",
        "my.yaml: network.rules.5.key: names the same keys as network.rules.4.key, 'a/**/*' (got 'a/*/**')",
    ]


@pytest.mark.parametrize("key", ["tis/MTML/measured_cp", "*/MTML/measured_$*"])
def test_a_tie_with_the_rule_of_the_topology_is_refused(key: str) -> None:
    made = scenario("observer", rules=[_rule("camera/left", 0), _rule(key, 1)])
    if key == "tis/MTML/measured_cp":
        with pytest.raises(InputError, match=r"^x: network\.rules\.1\.key: names the same keys as .*observer"):
            _compile(made, "x")
    else:  # wider than the generated rule: no tie
        assert _delay_ms(_compile(made, "x")["forward"], "tis/MTML/measured_cp") is None


def test_a_rule_for_both_directions_holds_in_both_and_ties_with_either() -> None:
    tables = _compile(scenario(rules=[_rule("camera/**", 5, "both"), _rule("camera/left", 6, "feedback")]), "x")
    assert [_delay_ms(tables[way], "camera/left") for way in ("forward", "feedback")] == [5, 6]
    for direction in ("forward", "feedback", "both"):
        with pytest.raises(InputError, match=r"network.rules.1.key: names the same keys as network.rules.0"):
            _compile(scenario(rules=[_rule("camera/**", 5, "both"), _rule("camera/**", 6, direction)]), "x")
