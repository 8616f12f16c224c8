"""Rules: which pipeline a key gets in one direction. The most specific matching key expression wins."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations
from typing import Final, Literal, NamedTuple

import zenoh

from common.channels import Direction
from common.errors import Fault, InputError
from common.scenario.network import NetworkPart, Rule
from common.scenario.network.pipeline import Pipeline

LINK: Final = "link"
_CLEAN: Final = Pipeline()


class Assigned(NamedTuple):
    """A key's pipeline, and the name of what it shares a rate with: ``link``, or its rule's expression."""

    pipeline: Pipeline
    group: str


@dataclass(frozen=True)
class RuleTable:
    """The rules of one direction, most specific first, and what holds where none of them matches."""

    rules: tuple[tuple[zenoh.KeyExpr, Pipeline], ...]
    defaults: tuple[zenoh.KeyExpr, ...]
    default: Pipeline
    unmatched: Literal["refuse", "pass"]

    def assign(self, key: str) -> Assigned | None:
        """Return the pipeline of ``key``; None: it is refused, as is a key that Zenoh could not carry."""
        try:
            expr = zenoh.KeyExpr(key)
        except zenoh.ZError:
            return None
        for rule, pipeline in self.rules:
            if rule.includes(expr):
                return Assigned(pipeline, str(rule))
        if any(keys.includes(expr) for keys in self.defaults):
            return Assigned(self.default, LINK)
        return Assigned(_CLEAN, "") if self.unmatched == "pass" else None


def compile_rules(
    network: NetworkPart, where: str, defaults: Sequence[str], generated: Sequence[Rule] = (),
    below: str = "network.rules",
) -> dict[Direction, RuleTable]:  # fmt: skip
    """Return the rules of both directions; raises `InputError` with every tie of the network's rules.

    Keys that no rule names get the direction's own pipeline when one of ``defaults`` includes them. ``generated`` are
    rules that nobody wrote, like those of a topology; ``below`` is where those that somebody wrote stand in the file
    ``where``. A tie are two rules of one direction that some key matches both, while neither is a special case of the
    other (oracle: literal tables in tests/netem/link/test_rules).
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
    """A rule, its field in the scenario and its expression; not ``written``: the topology generated it."""

    field: str
    written: bool
    rule: Rule
    expr: zenoh.KeyExpr

    def ties_with(self, other: "_Parsed") -> bool:
        ways = {self.rule.direction, other.rule.direction}
        if (len(ways) > 1 and "both" not in ways) or not self.expr.intersects(other.expr):
            return False
        return self.expr.includes(other.expr) == other.expr.includes(self.expr)


def _sorted(parsed: Sequence[_Parsed], direction: Direction) -> tuple[tuple[zenoh.KeyExpr, Pipeline], ...]:
    ours = [one for one in parsed if one.rule.direction in (direction, "both")]
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
