import zenoh
from hypothesis import given
from hypothesis import strategies as st

from tis.common.zenoh_syntax import KeySet, key_expression_fault, key_matches

CHUNK = st.sampled_from(["a", "b", "ab", "aab", "@x"])
PATTERN = st.sampled_from(["a", "*", "**", "a$*", "$*b", "$*a$*"])


@given(st.lists(PATTERN, min_size=1, max_size=4), st.lists(CHUNK, min_size=1, max_size=4))
def test_a_key_matches_as_zenoh_says(pattern: list[str], chunks: list[str]) -> None:
    expression, key = "/".join(pattern), "/".join(chunks)
    if key_expression_fault(expression) is None:
        expected = zenoh.KeyExpr.autocanonize(expression).includes(zenoh.KeyExpr(key))
        assert key_matches(expression, key) == expected


def test_a_set_holds_keys_and_expressions() -> None:
    keys = KeySet(["tis/PSM2/servo_cp", "0/device/left/*/*"])
    assert "tis/PSM2/servo_cp" in keys
    assert "0/device/left/geometry_msgs::msg::dds_::PoseStamped_/RIHS01_ab" in keys
    assert "0/device/right/x/y" not in keys
    assert keys
    assert not KeySet()
