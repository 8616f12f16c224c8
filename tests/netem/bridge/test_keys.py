import pytest

from tis.common.errors import InputError
from tis.netem.bridge.keys import CrossingKeys, crossing_keys, is_private


def test_beside_a_key_expression_lie_its_advanced_publishers_and_nothing_else() -> None:
    expected = ("demo/**", "demo/**/@adv/**")
    assert crossing_keys(["demo/**"]) == CrossingKeys(expected, expected)


@pytest.mark.parametrize(
    ("keys", "graph"),
    [
        (["0/**"], "@ros2_lv/0/**"),
        (["42/chatter/**"], "@ros2_lv/42/**"),
        (["**"], "@ros2_lv/**"),
        (["*/a"], "@ros2_lv/*/**"),
    ],
)
def test_a_domain_of_ros_2_has_its_graph_in_liveliness(keys: list[str], graph: str) -> None:
    found = crossing_keys(keys)
    assert found.tokens == (*found.messages, graph)
    assert graph not in found.messages


def test_what_another_expression_includes_adds_nothing() -> None:
    assert crossing_keys(["demo/a", "demo/**", "demo/**/b", "demo/**", "test/*"]).messages == (
        "demo/**", "demo/**/@adv/**", "test/*", "test/*/@adv/**",
    )  # fmt: skip


def test_every_bad_expression_is_named() -> None:
    with pytest.raises(InputError) as found:
        crossing_keys(["demo/*/a", "demo/b/*", "x//y", "tis/@tis/clock", "@/**", "s/netem/control/**"])
    assert [str(fault) for fault in found.value.faults] == [
        "netem: KEYEXPR: must be a Zenoh key expression, like demo/** (got 'x//y')",
        "netem: KEYEXPR: must not name control keys: they never cross (got 'tis/@tis/clock')",
        "netem: KEYEXPR: must not name control keys: they never cross (got '@/**')",
        "netem: KEYEXPR: must not name control keys: they never cross (got 's/netem/control/**')",
        "netem: KEYEXPR: must not share keys with demo/*/a: they would cross twice (got 'demo/b/*')",
    ]


@pytest.mark.parametrize(
    ("key", "private"),
    [
        ("tis/netem/control/set", True),
        ("other/netem/control", True),
        ("tis/netem/controls", False),
        ("netem/control/x", False),
        ("tis/MTML/measured_cp", False),
    ],
)
def test_control_keys_are_told_apart(key: str, private: bool) -> None:
    assert is_private(key) is private
