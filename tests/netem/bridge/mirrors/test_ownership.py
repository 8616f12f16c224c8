"""Which queryables are of others. The oracle: sets of key expressions, searched one by one."""

from dataclasses import dataclass

import pytest
import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.netem.bridge.mirrors.listing import owned_by_others, sample

_EXPRESSIONS = ("**", "a/**", "a/*", "a/b", "a/b/c", "*/b", "b", "a$*/b", "**/c", "a/*/c")


@dataclass
class Listed:
    """What netem sees of a network in which others have ``theirs``: expressions, and whether they are complete."""

    expr: zenoh.KeyExpr
    theirs: dict[str, bool]

    @property
    def is_answered(self) -> bool:
        return any(zenoh.KeyExpr(other).intersects(sample(self.expr)) for other in self.theirs)

    @property
    def is_complete(self) -> bool:
        return any(zenoh.KeyExpr(other).includes(self.expr) for other, complete in self.theirs.items() if complete)


def seen(theirs: dict[str, bool], own: set[str]) -> dict[str, Listed]:
    return {key: Listed(zenoh.KeyExpr(key), theirs) for key in theirs.keys() | own}


@pytest.mark.parametrize("expression", _EXPRESSIONS)
def test_a_sample_is_a_key_of_its_expression_and_of_those_that_include_it(expression: str) -> None:
    expr, key = zenoh.KeyExpr(expression), sample(zenoh.KeyExpr(expression))
    assert "*" not in str(key)
    assert expr.includes(key)
    for other in map(zenoh.KeyExpr, _EXPRESSIONS):
        assert other.includes(key) == other.includes(expr)


def test_a_mirror_alone_is_nobody_else_s() -> None:
    assert owned_by_others(seen({}, {"a/b"}), {"a/b"}) == set()
    assert owned_by_others(seen({"a/b/c": False}, {"a/b"}), {"a/b"}) == {"a/b/c"}


def test_the_same_expression_by_others_too_is_found() -> None:
    assert owned_by_others(seen({"a/b": False}, {"a/b"}), {"a/b"}) == {"a/b"}
    assert owned_by_others(seen({"**": False, "a/b": False}, {"a/b", "**"}), {"a/b", "**"}) == {"**"}


def test_a_complete_one_within_one_that_is_not_is_found() -> None:
    assert owned_by_others(seen({"a/**": False, "a/b": True}, {"a/b"}), {"a/b"}) == {"a/**", "a/b"}
    assert owned_by_others(seen({"a/**": False}, {"a/b"}), {"a/b"}) == {"a/**"}


@given(
    st.dictionaries(st.sampled_from(_EXPRESSIONS), st.booleans(), max_size=5),
    st.sets(st.sampled_from(_EXPRESSIONS), max_size=5),
)
@settings(max_examples=200, deadline=None)
def test_what_is_found_can_be_asked_what_others_can(theirs: dict[str, bool], own: set[str]) -> None:
    listed = seen(theirs, own)
    found = owned_by_others(listed, own)
    assert found >= theirs.keys() - own
    for key in ("a", "b", "a/b", "a/x", "a/b/c", "a/x/c", "aa/b", "c/d/c", "x/y/z"):
        question = zenoh.KeyExpr(key)
        there = [one for one in theirs if zenoh.KeyExpr(one).includes(question)]
        mirrored = [one for one in found if zenoh.KeyExpr(one).includes(question)]
        assert bool(there) == bool(mirrored)
        assert any(theirs[one] for one in there) == any(listed[one].is_complete for one in mirrored)
