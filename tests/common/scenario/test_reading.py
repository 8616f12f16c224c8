from collections.abc import Callable
from string import ascii_letters, digits
from typing import Any

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from tis.common.errors import InputError
from tis.common.scenario import Scenario
from tis.common.scenario.reading import apply_settings, build_scenario, digest, dump_scenario, parse_yaml, setting

MINIMAL: dict[str, Any] = {"version": 1, "name": "a", "source": {"kind": "synthetic"}}
FULL = """
version: 1
name: paper_3
seed: 7
duration_s: 30
source: {kind: jigsaws, path: data/jigsaws, task: Suturing, trial: D002, hands: [left], pairing: auto, start: auto}
rate_hz: 30
topology: teleoperation
surgeon: {copies: 1, history: 0}
patient: {tick: free, tick_phase_ms: 2, plant: {kind: replay}}
network:
  unmatched: refuse
  forward:
    delay: {kind: constant, delay_ms: 1.0}
    jitter: {kind: normal, std_ms: 0.1}
    loss: {kind: bernoulli, p_loss: 0.0001}
    ordering: fifo
  feedback: {delay: {kind: uniform, low_ms: 1.0, high_ms: 2.5}}
  rules: [{key: "*/MTML/measured_cp", direction: forward, pipeline: {}}]
  timeline: [{at_s: 10, for_s: 0.5, direction: forward, set: {outage: true}}]
identification: {method: moesp, train: own_head, train_samples: 1240, block_rows: 10, order: 4}
estimators: [hold, moesp_kf]
active_estimator: moesp_kf
limits: {end_to_end_p99_ms: 50, p_loss_max: 0.01}
hosts: {west: "tcp/10.0.0.1:7447", east: "tcp/10.0.0.2:7448"}
security: {kind: none}
on_peer_loss: end
"""


ORDER_RULE = "must be an integer >= 0 or one of auto, energy, gap, criterion, validation"


def build(**changes: Any) -> Scenario:
    return build_scenario(MINIMAL | changes, "s.yaml")


def faults(**changes: Any) -> list[str]:
    with pytest.raises(InputError) as caught:
        build(**changes)
    return [str(fault).removeprefix("s.yaml: ") for fault in caught.value.faults]


def refusal(action: Callable[[], object]) -> InputError | None:
    try:
        action()
    except InputError as error:
        return error
    return None


def set_faults(*assignments: str) -> list[str]:
    with pytest.raises(InputError) as caught:
        apply_settings(MINIMAL | {"estimators": ["hold", "moesp_kf"]}, assignments)
    return [str(fault) for fault in caught.value.faults]


# ---- reading and writing


def test_a_full_scenario_survives_yaml() -> None:
    scenario = build_scenario(parse_yaml(FULL, "s.yaml"), "s.yaml")
    assert scenario.source.kind == "jigsaws"
    assert scenario.identification.order == 4
    assert build_scenario(parse_yaml(dump_scenario(scenario), "again"), "again") == scenario


numbers = st.floats(0, 1e6, allow_subnormal=False)
begins = ascii_letters + digits + "_"
names = st.builds(str.__add__, st.sampled_from(begins), st.text(begins + ".-", max_size=11))
delays = st.one_of(
    st.fixed_dictionaries({"kind": st.just("constant"), "delay_ms": numbers}),
    st.fixed_dictionaries({"kind": st.just("normal"), "mean_ms": numbers, "std_ms": numbers}),
)
scenarios = st.fixed_dictionaries(
    {"version": st.just(1), "name": names, "source": st.just({"kind": "synthetic"})},
    optional={
        "session": names,
        "seed": st.integers(0, 2**70),
        "duration_s": st.floats(0.1, 86_400),
        "network": st.fixed_dictionaries({}, optional={"forward": st.fixed_dictionaries({"delay": delays})}),
        "estimators": st.just(["innovations_kf"]),
        "on_peer_loss": st.sampled_from([None, "end"]),
        "identification": st.fixed_dictionaries({"order": st.integers(0, 50) | st.just("auto")}),
    },
)


@settings(deadline=None, max_examples=60)
@given(scenarios)
def test_dump_and_build_are_inverse(raw: dict[str, Any]) -> None:
    scenario = build_scenario(raw, "s.yaml")
    again = build_scenario(parse_yaml(dump_scenario(scenario), "again"), "again")
    assert again == scenario
    assert digest(again) == digest(scenario)


def test_the_digest_names_what_was_agreed_on() -> None:
    assert len(digest(build())) == 16
    assert digest(build()) != digest(build(seed=2))
    elsewhere = build(hosts={"west": "tcp/a:1", "east": "tcp/b:2"}, on_peer_loss="end")
    assert digest(elsewhere) == digest(build())


@pytest.mark.parametrize("text", ["", "# nothing yet\n"])
def test_an_empty_file_is_called_so(text: str) -> None:
    with pytest.raises(InputError, match=r"^s\.yaml: is empty: must be a mapping of keys to values$"):
        parse_yaml(text, "s.yaml")


@pytest.mark.parametrize("text", ["- a\n- b\n", "hello", "3"])
def test_a_file_must_be_a_mapping(text: str) -> None:
    with pytest.raises(InputError, match=r"^s\.yaml: must be a mapping of keys to values"):
        parse_yaml(text, "s.yaml")


# ---- what a user reads


@pytest.mark.parametrize(
    ("changes", "expected"),
    [
        ({"hosts": "foo"}, "hosts: must be 'auto' or {west: ENDPOINT, east: ENDPOINT} (got 'foo')"),
        ({"hosts": ["auto"]}, "hosts: must be 'auto' or {west: ENDPOINT, east: ENDPOINT} (got ['auto'])"),
        (
            {"hosts": {"west": "tcp/a:1", "east": "b:2"}},
            "hosts.east: must be PROTOCOL/ADDRESS, like tcp/127.0.0.1:7447 (got 'b:2')",
        ),
        ({"hosts": {"west": "tcp/a:1"}}, "hosts.east: is required"),
        (
            {"identification": {"order": "foo"}},
            f"identification.order: {ORDER_RULE} (got 'foo')",
        ),
        (
            {"identification": {"order": -1}},
            f"identification.order: {ORDER_RULE} (got -1)",
        ),
        (
            {"source": {"kind": "jigsaws", "trial": "2"}},
            "source.trial: must be a letter and three digits, like D002 (got '2')",
        ),
        (
            {"source": {"kind": "jigsaws", "start": "now"}},
            "source.start: must be a row number (an integer >= 0) or 'auto' (got 'now')",
        ),
        (
            {"source": {"kind": "video"}},
            "source.kind: must be 'jigsaws' or 'table' or 'synthetic' or 'live' (got 'video')",
        ),
        ({"source": {}}, "source.kind: is required ('jigsaws' or 'table' or 'synthetic' or 'live')"),
        ({"source": "synthetic"}, "source: must be a mapping with a kind (got 'synthetic')"),
        (
            {"network": {"forward": {"delay": {"kind": "uniform", "low_ms": 3, "high_ms": 1}}}},
            "network.forward.delay: high_ms must be at least low_ms = 3.0",
        ),
        (
            {"network": {"feedback": {"delay": {"kind": "constant", "delay_ms": -1}}}},
            "network.feedback.delay.delay_ms: must be at least 0 (got -1)",
        ),
        (
            {"network": {"feedback": {"loss": {"kind": "bernoulli", "p_loss": 1.5}}}},
            "network.feedback.loss.p_loss: must be at most 1 (got 1.5)",
        ),
        (
            {"network": {"feedback": {"jitter": {"kind": "normal", "std_ms": 1}}}},
            "network.feedback: jitter needs a delay to deviate from",
        ),
        (
            {"network": {"timeline": [{"at_s": 1, "for_s": 1, "direction": "up", "set": {"outage": True}}]}},
            "network.timeline.0.direction: must be 'forward', 'feedback' or 'both' (got 'up')",
        ),
        ({"network": {"forwards": {}}}, "network.forwards: unknown key, did you mean 'forward'? (got {})"),
        ({"estimators": []}, "estimators: must have at least 1 item (got [])"),
        (
            {"estimators": ["hold", "hold"]},
            "estimators: must name each estimator at most once (got ['hold', 'hold'])",
        ),
        (
            {"name": "a/b"},
            "name: must consist of letters, digits, '_', '.' and '-', and not begin with '.' or '-' (got 'a/b')",
        ),
        ({"seed": None}, "seed: must be an integer (got None)"),
        ({"duration_s": float("nan")}, "duration_s: must be a finite number (got nan)"),
        ({"rate_hz": 20_000}, "rate_hz: must be at most 10000 (got 20000)"),
        ({"security": {"kind": "none", "cert": 1}}, "security.cert: unknown key (got 1)"),
        (
            {"security": {"kind": "mtls", "control": ["a b"]}},
            "security.control.0: must be a name of up to 64 letters, digits, '_', '.' and '-', not beginning with "
            "'.' or '-' (got 'a b')",
        ),
        (
            {"security": {"kind": "password", "observers": ["surgeon"]}},
            "security.observers.0: must not be one of surgeon, netem, patient, whose rights are fixed "
            "(got 'surgeon')",
        ),
        (
            {"security": {"kind": "mtls"}, "hosts": {"west": "tls/10.0.0.1:1", "east": "tcp/10.0.0.1:2"}},
            "hosts must be endpoints like tls/192.168.1.5:7447 with security mtls",
        ),
        ({"version": 2}, "version: must be 1 (got 2)"),
        (
            {"estimators": ["hold"], "active_estimator": "moesp_kf"},
            "active_estimator moesp_kf must be one of estimators (hold)",
        ),
        (
            {"estimators": ["hold", "my_filter:AlphaBeta"], "active_estimator": "my_filter:AlfaBeta"},
            "active_estimator my_filter:AlfaBeta must be one of estimators (hold, my_filter:AlphaBeta), did you mean "
            "'my_filter:AlphaBeta'?",
        ),
        ({"duration_s": 0.01}, "duration_s must contain at least one sample at rate_hz"),
        (
            {"identification": {"train": "others"}},
            "identification.train must be own_head or a model file: a synthetic source has no other subjects",
        ),
    ],
)
def test_one_mistake_is_one_line(changes: dict[str, Any], expected: str) -> None:
    assert faults(**changes) == [expected]


def test_every_faulty_field_is_named_at_once() -> None:
    found = faults(
        sed=1,
        seed=-1,
        network={"forward": {"delay": {"kind": "constant"}, "loss": 3}, "rules": [{"key": ""}]},
        estimators=["guess"],
    )
    assert [line.split(": ")[0] for line in sorted(found)] == [
        "estimators.0",
        "network.forward.delay.delay_ms",
        "network.forward.loss",
        "network.rules.0.direction",
        "network.rules.0.key",
        "network.rules.0.pipeline",
        "sed",
        "seed",
    ]


def test_rules_between_fields_are_checked_together_too() -> None:
    found = faults(source={"kind": "jigsaws"}, rate_hz=1000, estimators=["hold"])
    assert [line.split(" must")[0] for line in found] == [
        "active_estimator innovations_kf",
        "rate_hz",
        "patient.tick_phase_ms",
    ]


# ---- whatever comes in


def fields(schema: Any) -> set[str]:
    """Return every key of a schema: a value under a real name gets further than one under a random one."""
    if isinstance(schema, dict):
        return set(schema.get("properties", ())).union(*(fields(below) for below in schema.values()))
    return set().union(*(fields(below) for below in schema)) if isinstance(schema, list) else set()


FIELDS = sorted(fields(Scenario.model_json_schema()))
words = ["auto", "constant", "normal", "uniform", "jigsaws", "synthetic", "none", "replay", "hold", "Hosts"]
leaves = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5) | st.sampled_from(words)
values = st.recursive(
    leaves,
    lambda below: (
        st.lists(below, max_size=3)
        | st.dictionaries(st.sampled_from(FIELDS) | st.text(max_size=5), below, max_size=5)
    ),
    max_leaves=20,
)


@settings(deadline=None, max_examples=150)
@example({"[key]": None}, False)  # as pydantic marks the key of a mapping
@given(
    st.dictionaries(st.sampled_from(list(Scenario.model_fields)) | st.text(max_size=5), values, max_size=8),
    st.booleans(),
)
def test_any_mapping_is_a_scenario_or_an_input_error(raw: dict[str, Any], complete: bool) -> None:
    error = refusal(lambda: build_scenario(MINIMAL | raw if complete else raw, "s.yaml"))
    if error is not None:
        lines = str(error).split("\n")
        assert len(lines) == len(error.faults)
        assert all(line.startswith("s.yaml: ") for line in lines)


@settings(deadline=None, max_examples=100)
@given(st.text(max_size=60) | st.text(alphabet="ab: \n-[]{}&*<", max_size=60))
def test_any_text_is_a_mapping_or_an_input_error(text: str) -> None:
    error = refusal(lambda: dict.items(parse_yaml(text, "s.yaml")))
    assert error is None or str(error).startswith("s.yaml: ")


def test_nesting_beyond_the_stack_is_an_input_error() -> None:
    path = ".".join(["a"] * 5000)
    raw = apply_settings(MINIMAL, [f"{path}=1"])
    with pytest.raises(InputError, match=r"^s\.yaml: is nested too deeply$"):
        build_scenario(raw, "s.yaml")


# ---- --set


@pytest.mark.parametrize(
    ("assignment", "place", "value"),
    [
        ("seed=3", ("seed",), 3),
        ("name=x=y", ("name",), "x=y"),
        ("network.forward.delay={kind: constant, delay_ms: 5}", ("network", "forward", "delay", "delay_ms"), 5),
        ("network.forward.delay.delay_ms=5", ("network", "forward", "delay", "delay_ms"), 5),
        ("source.hands=[left, right]", ("source", "hands", 1), "right"),
        ("estimators.1=static_gain", ("estimators", 1), "static_gain"),
        ("rules.0.pipeline.loss=1", ("rules", 0, "pipeline", "loss"), 1),
        ("estimators.0.deep=1", ("estimators", 0, "deep"), 1),
    ],
)
def test_set_puts_a_value_in_its_place(assignment: str, place: tuple[str | int, ...], value: Any) -> None:
    raw = {**MINIMAL, "estimators": ["hold", "moesp_kf"], "rules": [{"pipeline": {}}]}
    found: Any = apply_settings(raw, [assignment])
    for step in place:
        found = found[step]
    assert found == value


def test_null_removes_a_key_or_an_item() -> None:
    raw = {"a": 1, "b": {"c": 2, "d": 3}, "e": [4, 5, 6]}
    removed = apply_settings(raw, ["a=null", "b.c=~", "e.1=null", "never.there=null"])
    assert removed == {"b": {"d": 3}, "e": [4, 6], "never": {}}


def test_set_leaves_its_argument_alone_even_where_yaml_shared_an_object() -> None:
    raw = parse_yaml("a: &x {n: 1, l: [1]}\nb: *x\n", "s.yaml")
    changed = apply_settings(raw, ["a.n=2", "a.l.0=2"])
    assert changed == {"a": {"n": 2, "l": [2]}, "b": {"n": 1, "l": [1]}}
    assert raw == {"a": {"n": 1, "l": [1]}, "b": {"n": 1, "l": [1]}}


def test_later_settings_see_earlier_ones() -> None:
    assert apply_settings({}, ["a.b=1", "a.c=2", "a.b=3"]) == {"a": {"b": 3, "c": 2}}


@pytest.mark.parametrize(
    ("assignment", "expected"),
    [
        ("seed", "--set: seed: must read a.b=VALUE"),
        ("=1", "--set: =1: must read a.b=VALUE"),
        ("a..b=1", "--set: a..b=1: must read a.b=VALUE"),
        ("estimators.2=hold", "--set: estimators.2: '2' is not an index of a list of 2"),
        ("estimators.-1=hold", "--set: estimators.-1: '-1' is not an index of a list of 2"),
        ("estimators.x.y=1", "--set: estimators.x.y: 'x' is not an index of a list of 2"),
        ("seed=[1", "--set: seed: not YAML: did not find expected ',' or ']' (got '[1')"),
        ("seed=!!int x", "--set: seed: the tag 'tag:yaml.org,2002:int' is not allowed (got '!!int x')"),
    ],
)
def test_a_bad_setting_is_one_line(assignment: str, expected: str) -> None:
    assert set_faults(assignment) == [expected]


def test_all_bad_settings_are_named() -> None:
    assert len(set_faults("seed", "estimators.9=1", "seed=[", "name=ok")) == 3


@settings(deadline=None, max_examples=150)
@given(st.text(alphabet="ab.01=-[]{}: ", max_size=20))
def test_any_setting_is_applied_or_refused(assignment: str) -> None:
    raw = {"a": {"b": [1, {"a": 2}]}, "b": [[0], "x"]}
    error = refusal(lambda: dict.items(apply_settings(raw, [assignment])))
    assert error is None or str(error).startswith("--set: ")
    assert raw == {"a": {"b": [1, {"a": 2}]}, "b": [[0], "x"]}


def test_a_setting_is_read_as_the_value_that_it_was_made_of() -> None:
    value = {"kind": "table", "path": "it's, {mine}: #1 é.csv", "hands": ["left", "right"], "resample": True}
    assert apply_settings({}, [setting("source", value)]) == {"source": value}
