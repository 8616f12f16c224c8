"""Rules: which pipeline a key gets in one direction. The most specific matching key expression wins."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Literal, NamedTuple

import zenoh

from common.channels import Direction
from common.errors import Fault, InputError
from common.scenario import Scenario
from common.scenario.network import Pipeline, Rule

_CLEAN = Pipeline()


@dataclass(frozen=True)
class RuleTable:
    """The rules of one direction, most specific first, and what holds where none of them matches."""

    rules: tuple[tuple[zenoh.KeyExpr, Pipeline], ...]
    session: zenoh.KeyExpr
    default: Pipeline
    unmatched: Literal["refuse", "pass"]

    def pipeline(self, key: str) -> Pipeline | None:
        """Return the pipeline of ``key``; None: it is refused, as is a key that Zenoh could not carry."""
        try:
            expr = zenoh.KeyExpr(key)
        except zenoh.ZError:
            return None
        for rule, pipeline in self.rules:
            if rule.includes(expr):
                return pipeline
        if self.session.includes(expr):
            return self.default
        return _CLEAN if self.unmatched == "pass" else None


def compile_rules(scenario: Scenario, where: str) -> dict[Direction, RuleTable]:
    """Return the rules of both directions; raises `InputError` with every fault of the scenario's rules.

    Refused are expressions that are not Zenoh's, and ties: two rules of one direction that some key matches
    both, while neither is a special case of the other (oracle: literal tables in tests/netem/test_rules).
    """
    n_written = len(scenario.network.rules)
    parsed: list[_Parsed] = []
    faults: list[Fault] = []
    for i, rule in enumerate(scenario.rules()):
        field = f"network.rules.{i}.key"
        try:
            parsed.append(_Parsed(field, i < n_written, rule, zenoh.KeyExpr.autocanonize(rule.key)))
        except zenoh.ZError as error:
            faults.append(Fault(where, field, f"must be a Zenoh key expression: {_reason(error)}", rule.key))
    faults += [_tie(where, one, two) for one, two in combinations(parsed, 2) if one.ties_with(two)]
    if faults:
        raise InputError(faults)
    session = zenoh.KeyExpr(f"{scenario.session}/**")
    network = scenario.network
    return {
        "forward": RuleTable(_sorted(parsed, "forward"), session, network.forward, network.unmatched),
        "feedback": RuleTable(_sorted(parsed, "feedback"), session, network.feedback, network.unmatched),
    }


class _Parsed(NamedTuple):
    """A rule, its field in the scenario and its expression; not ``written``: the topology generated it."""

    field: str
    written: bool
    rule: Rule
    expr: zenoh.KeyExpr

    def ties_with(self, other: "_Parsed") -> bool:
        if self.rule.direction != other.rule.direction or not self.expr.intersects(other.expr):
            return False
        return self.expr.includes(other.expr) == other.expr.includes(self.expr)


def _sorted(parsed: Sequence[_Parsed], direction: Direction) -> tuple[tuple[zenoh.KeyExpr, Pipeline], ...]:
    ours = [one for one in parsed if one.rule.direction == direction]
    # the rules that match one key form a chain of special cases, so the number of generalisations sorts them
    ranked = sorted(ours, key=lambda one: sum(other.expr.includes(one.expr) for other in ours), reverse=True)
    return tuple((one.expr, one.rule.pipeline) for one in ranked)


def _tie(where: str, earlier: _Parsed, later: _Parsed) -> Fault:
    """Blame the later rule of a tie, unless the topology generated it: only what is written can be mended."""
    blamed, other = (later, earlier) if later.written else (earlier, later)
    origin = other.field if other.written else "the rule that topology observer generates"
    relation = (
        "names the same keys as"
        if blamed.expr.includes(other.expr)
        else "shares keys with, but is no special case of,"
    )
    return Fault(where, blamed.field, f"{relation} {origin}, {other.rule.key!r}", blamed.rule.key)


def _reason(error: zenoh.ZError) -> str:
    """Return the library's reason without the expression before it and the source line behind it."""
    text = str(error).partition("`: ")[2] or str(error)
    return text.partition(" at /")[0]
