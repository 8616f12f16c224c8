"""Key expressions; the oracle is Zenoh."""

import zenoh
from hypothesis import given, settings
from hypothesis import strategies as st

from tis.common.zenoh_syntax import key_expression_fault


def _zenoh_takes(text: str) -> bool:
    try:
        zenoh.KeyExpr.autocanonize(text)
    except zenoh.ZError:
        return False
    return True


@given(st.text("ab/*$#?@", max_size=8).filter(lambda text: "$*$*" not in text))
@settings(max_examples=400)
def test_what_zenoh_takes_has_no_fault_and_nothing_else(text: str) -> None:
    assert (key_expression_fault(text) is None) == _zenoh_takes(text)


def test_what_zenoh_may_crash_of_is_refused() -> None:
    assert key_expression_fault("a$*$*") is not None
    assert key_expression_fault("a$*b$*") is None


def test_the_rule_is_named() -> None:
    assert "no slash at the beginning" in (key_expression_fault("/demo/alarm") or "")
    assert "no other *, $, # or ?" in (key_expression_fault("demo/a*") or "")
