"""Rules: the pipeline of a key in one direction. The most specific matching key expression wins."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal, NamedTuple

import zenoh

from tis.common.channels import Direction
from tis.common.errors import Fault, InputError
from tis.common.scenario.network import NetworkPart, Rule
from tis.common.scenario.network.pipeline import Pipeline

LINK: Final = "link"
_PASSED: Final = ""
_CLEAN: Final = Pipeline()


class Assigned(NamedTuple):
    """A key's pipeline and the group of keys that share its rate: ``link``, or its rule's expression."""

    pipeline: Pipeline
    group: str


@dataclass(frozen=True)
class RuleTable:
    """The rules of one direction, most specific first, and the default where none of them matches."""

    rules: tuple[tuple[zenoh.KeyExpr, Pipeline], ...]
    defaults: tuple[zenoh.KeyExpr, ...]
    default: Pipeline
    unmatched: Literal["refuse", "pass"]

    @property
    def pipelines(self) -> dict[str, Pipeline]:
        """Return the pipeline of each group of keys that share a rate."""
        return {str(rule): pipeline for rule, pipeline in self.rules} | {LINK: self.default, _PASSED: _CLEAN}

    def assign(self, key: str) -> Assigned | None:
        """Return the pipeline of ``key``; None if it is refused, as is an invalid key."""
        try:
            expr = zenoh.KeyExpr(key)
        except zenoh.ZError:
            return None
        for rule, pipeline in self.rules:
            if rule.includes(expr):
                return Assigned(pipeline, str(rule))
        if any(keys.includes(expr) for keys in self.defaults):
            return Assigned(self.default, LINK)
        return Assigned(_CLEAN, _PASSED) if self.unmatched == "pass" else None


def compile_rules(
    network: NetworkPart, where: str, defaults: Sequence[str], generated: Sequence[Rule] = (),
    below: str = "network.rules",
) -> dict[Direction, RuleTable]:  # fmt: skip
    """Return the rules of both directions; raises `InputError` with every tie of the network's rules.

    Keys without a rule get the direction's own pipeline if one of ``defaults`` includes them. ``generated`` are rules
    of the topology, which are not in the file ``where``; ``below`` is the field of the written ones. A tie is a pair
    of rules of one direction that share a key while neither is a special case of the other (oracle: literal tables,
    tests/netem/link/test_rules).
    """
    n_written = len(network.rules)
    parsed = [
        _Parsed(f"{below}.{i}.key", i < n_written, rule, zenoh.KeyExpr.autocanonize(rule.key))
        for i, rule in enumerate((*network.rules, *generated))
    ]
    faults = [_tie(where, one, two) for one, two in combinations(parsed, 2) if one.ties_with(two)]
    if faults:
        raise InputError(faults)
    keys = tuple(zenoh.KeyExpr.autocanonize(expr) for expr in defaults)

    def table(direction: Direction, default: Pipeline) -> RuleTable:
        return RuleTable(_sorted(parsed, direction), keys, default, network.unmatched)

    return {"forward": table("forward", network.forward), "feedback": table("feedback", network.feedback)}


class _Parsed(NamedTuple):
    """A rule, its field in the scenario and its expression; if not ``written``, the topology generated it."""

    field: str
    written: bool
    rule: Rule
    expr: zenoh.KeyExpr

    def ties_with(self, other: "_Parsed") -> bool:
        directions = {self.rule.direction, other.rule.direction}
        if (len(directions) > 1 and "both" not in directions) or not self.expr.intersects(other.expr):
            return False
        return self.expr.includes(other.expr) == other.expr.includes(self.expr)


def _sorted(parsed: Sequence[_Parsed], direction: Direction) -> tuple[tuple[zenoh.KeyExpr, Pipeline], ...]:
    relevant = [one for one in parsed if one.rule.direction in (direction, "both")]
    # without ties, the rules that match one key form a chain of special cases: sort by the number of wider rules
    ranked = sorted(relevant, key=lambda one: sum(other.expr.includes(one.expr) for other in relevant), reverse=True)
    return tuple((one.expr, one.rule.pipeline) for one in ranked)


def _tie(where: str, earlier: _Parsed, later: _Parsed) -> Fault:
    """Return the fault of the later rule of a tie, or of the earlier one if the topology generated the later."""
    blamed, other = (later, earlier) if later.written else (earlier, later)
    origin = other.field if other.written else "the rule that topology observer generates"
    relation = (
        "names the same keys as"
        if blamed.expr.includes(other.expr)
        else "shares keys with, but is no special case of,"
    )
    return Fault(where, blamed.field, f"{relation} {origin}, {other.rule.key!r}", blamed.rule.key)
