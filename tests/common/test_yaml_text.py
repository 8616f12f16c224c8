import contextlib
import datetime

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tis.common.errors import InputError
from tis.common.yaml_text import load_yaml


def fault(text: str) -> str:
    with pytest.raises(InputError) as caught:
        load_yaml(text, "s.yaml")
    assert len(caught.value.faults) == 1
    return str(caught.value)


def test_plain_settings_are_what_they_look_like() -> None:
    text = "a: 1\nb: [1.5, yes, null, x, 0x1F]\nc: {d: 'e', f: 2001-02-03}\n"
    date = datetime.date(2001, 2, 3)
    assert load_yaml(text, "s.yaml") == {"a": 1, "b": [1.5, True, None, "x", 31], "c": {"d": "e", "f": date}}
    assert load_yaml("", "s.yaml") is None


def test_aliases_and_merges_may_save_typing() -> None:
    text = "a: &d {kind: constant, delay_ms: 1}\nb: *d\nc: {<<: *d, delay_ms: 2}\n"
    one = {"kind": "constant", "delay_ms": 1}
    assert load_yaml(text, "s.yaml") == {"a": one, "b": one, "c": {"kind": "constant", "delay_ms": 2}}


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("a: 1\nb: 2\na: 3\n", "s.yaml: line 3: key 'a' must appear only once"),
        ("a:\n  - {b: 1, 'b': 2}\n", "s.yaml: line 2: key 'b' must appear only once"),
        ("a: 1\nb: [1, }\n", "s.yaml: line 2: not YAML: did not find expected node content"),
        ("a: *nobody\n", "s.yaml: line 1: not YAML: found undefined alias"),
        ("a: &a\n  b: *a\n", "s.yaml: line 2: 'a' must not contain itself"),
        ("a: !!python/object:os.system x\n", "s.yaml: line 1: the tag 'tag:yaml.org,2002:python/object:os.system'"),
        ("a: 1\n---\nb: 2\n", "s.yaml: line 2: not YAML: but found another document"),
        ("? [a]\n: 1\n", "s.yaml: line 1: not YAML: found unhashable key"),
        ("a: 2001-02-30\n", "s.yaml: not YAML: day is out of range for month"),
        ("a: 0x_\n", "s.yaml: not YAML: invalid literal for int()"),
        ("a: \0\n", "s.yaml: not YAML: unacceptable character"),
        ("\ud800", "s.yaml: not YAML: 'utf-8' codec can't encode character"),
        ("a: 1" + ":59" * 400 + ".5", "s.yaml: not YAML: int too large to convert to float"),
        ("a: " + "9" * 5000, "s.yaml: line 1: a value must have at most 2000 characters"),
    ],
)
def test_what_is_wrong_and_in_which_line(text: str, expected: str) -> None:
    assert fault(text).startswith(expected)


@pytest.mark.parametrize(
    "text",
    ["[" * 60 + "]" * 60, "[" * 300_000, "a: {" * 60, "- " * 300_000 + "x", "? " * 300_000],
    ids=["list", "unclosed", "mapping", "block", "keys"],
)
def test_deep_nesting_is_refused_before_it_can_exhaust_the_stack(text: str) -> None:
    assert fault(text) == "s.yaml: line 1: must be nested at most 50 levels deep"


def test_fifty_levels_are_allowed_and_aliases_do_not_hide_depth() -> None:
    load_yaml("[" * 50 + "]" * 50, "s.yaml")
    chain = ["a0: &a0 x"] + [f"a{i}: &a{i} [*a{i - 1}]" for i in range(1, 60)]
    load_yaml("\n".join(chain[:50]), "s.yaml")
    assert fault("\n".join(chain)) == "s.yaml: line 51: must be nested at most 50 levels deep"


def test_a_text_of_megabytes_is_refused_unread() -> None:
    with pytest.raises(InputError, match="must have at most 4000000 characters"):
        load_yaml("#" * 4_000_001, "a.yaml")


def test_a_bomb_of_aliases_is_refused_by_its_size_written_out() -> None:
    layers = ["l0: &l0 [x]"] + [f"l{i}: &l{i} [{', '.join([f'*l{i - 1}'] * 9)}]" for i in range(1, 10)]
    assert fault("\n".join(layers)).endswith("must have at most 100000 values, with every alias expanded")
    merges = ["l0: &l0 {x: 1}"] + [f"l{i}: &l{i} {{<<: [{', '.join([f'*l{i - 1}'] * 9)}]}}" for i in range(1, 10)]
    assert fault("\n".join(merges)).endswith("must have at most 100000 values, with every alias expanded")


yaml_like = st.text(alphabet="ab01 \n:-[]{}&*!?|>'\"#%@,.<~=x_+eE", max_size=60)


@settings(deadline=None, max_examples=400)
@given(yaml_like | st.text(max_size=40))
@example("!!bool foo")
@example("!!timestamp foo")
@example("=")
@example("<<: 1")
@example("<<: [1]")
@example("%YAML 9.9\n--- a")
@example("1:60:60: 2")
def test_any_text_is_read_or_refused(text: str) -> None:
    with contextlib.suppress(InputError):
        load_yaml(text, "s.yaml")
