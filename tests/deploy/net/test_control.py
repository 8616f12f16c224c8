"""``tis net show|set|outage|reset`` against a bridge in this process, and what they make of their words."""

import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from tests.common.runtime.live_zenoh import a_router
from tests.deploy.commands import call
from tests.netem.bridge.controlled_bridge import Running, running_bridge
from tis.common.errors import InputError
from tis.common.runtime import emulator_client, running
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_router
from tis.common.scenario.control import Acknowledgement, EmulatorState
from tis.common.scenario.network.pipeline import Pipeline
from tis.deploy.net.control import notes_on, read_change, seconds, state_table

NORMAL = {"delay": {"kind": "normal", "mean_ms": 30, "std_ms": 2}}
LOSSY = {"loss": {"kind": "bernoulli", "p_loss": 0.1}}
BURSTY = {"loss": {"kind": "burst", "p_loss": 0.02, "mean_burst": 3}}
SILENCED = {"loss": {"kind": "burst", "p_loss": 0, "mean_burst": 3}}
RATED = {"rate": {"kbit_s": 8, "queue": {"kind": "codel", "target_ms": 9}}}

Tis = Callable[..., tuple[int, str, str]]


@pytest.mark.parametrize(
    ("now", "settings", "change"),
    [
        ({}, ["delay.delay_ms=50"], {"delay": {"kind": "constant", "delay_ms": 50}}),
        (NORMAL, ["delay.mean_ms=40"], {"delay": {"kind": "normal", "mean_ms": 40, "std_ms": 2}}),
        (NORMAL, ["delay.delay_ms=50"], {"delay": {"kind": "constant", "delay_ms": 50}}),
        (NORMAL, ["delay.shape=3", "delay.scale_ms=2"], {"delay": {"kind": "pareto", "shape": 3, "scale_ms": 2}}),
        (NORMAL, ["jitter.std_ms=1"], {"jitter": {"kind": "normal", "std_ms": 1}}),
        (LOSSY, ["loss.mean_burst=4"], {"loss": {"kind": "burst", "p_loss": 0.1, "mean_burst": 4}}),
        (LOSSY, ["loss={kind: bernoulli, p_loss: 0}"], {"loss": {"kind": "bernoulli", "p_loss": 0}}),
        (BURSTY, ["loss.p_loss=0"], SILENCED),
        (SILENCED, ["loss.p_loss=0.1"], {"loss": {"kind": "burst", "p_loss": 0.1, "mean_burst": 3}}),
        (RATED, ["rate.kbit_s=9"], {"rate": {"kbit_s": 9, "queue": {"kind": "codel", "target_ms": 9}}}),
        (RATED, ["rate.queue.kind=tail_drop"], {"rate": {"kbit_s": 8}}),  # the default queue
        ({}, ["rate=link", "scale_delay=2", "outage=true"], {"rate": "link", "scale_delay": 2, "outage": True}),
        (NORMAL, ["correlation.half_life_s=3"], {"correlation": {"half_life_s": 3}}),
    ],
)
def test_what_is_given_in_part_is_completed(now: dict[str, Any], settings: list[str], change: dict[str, Any]) -> None:
    found = read_change(settings, None, Pipeline.model_validate(now))
    assert found.model_dump(exclude_none=True, exclude_defaults=True) == change


def test_settings_override_the_yaml_beside_them() -> None:
    found = read_change(["delay.delay_ms=7"], "{delay: {kind: constant, delay_ms: 5}, ordering: reorder}", Pipeline())
    assert found.model_dump(exclude_unset=True) == {
        "delay": {"kind": "constant", "delay_ms": 7}, "ordering": "reorder",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("settings", "fault"),
    [
        (["delay.delay_ms=-3"], "tis net set: delay.delay_ms: must be at least 0 (got -3)"),
        (["delay.foo=3"], "tis net set: delay: must be kind: constant|uniform|normal|lognormal"),
        (["loss.mean_burst=3", "loss.p_bad=0.1"], "no kind has mean_burst and p_bad together (see `tis net stages`)"),
        (["los.p_loss=1"], "tis net set: los: unknown key, did you mean 'loss'? (got {'p_loss': 1})"),
        (["delay.mean_ms=3"], "tis net set: delay.std_ms: is required"),
        (["delay"], "tis net set: delay: must read a.b=VALUE"),
        (["delay.delay_ms=[1"], "tis net set: delay.delay_ms: not YAML"),
    ],
)
def test_what_is_wrong_is_said_in_the_words_of_the_scenario(settings: list[str], fault: str) -> None:
    with pytest.raises(InputError) as error:
        read_change(settings, None, Pipeline())
    assert fault in str(error.value)


def test_a_value_that_the_kind_in_force_refuses_does_not_replace_the_kind() -> None:
    with pytest.raises(InputError) as error:
        read_change(["loss.p_loss=1"], None, Pipeline.model_validate(BURSTY))
    assert str(error.value) == "tis net set: loss.p_loss: must be less than 1 (got 1)"


@pytest.mark.parametrize(
    ("text", "expected_s"),
    [("500ms", 0.5), ("2s", 2), ("1.5min", 90), ("250us", 0.00025), ("1h", 3600), ("0.5", 0.5)],
)
def test_a_length_of_time_is_in_s_or_has_its_unit(text: str, expected_s: float) -> None:
    assert seconds(text, "--for-s") == pytest.approx(expected_s, rel=1e-12)


@pytest.mark.parametrize("text", ["2 days", "-1s", "", "1e3s", "s"])
def test_what_is_no_length_of_time_is_refused(text: str) -> None:
    with pytest.raises(InputError, match="must be a duration in s"):
        seconds(text, "--for-s")


@pytest.fixture
def tis(monkeypatch: pytest.MonkeyPatch) -> Tis:
    monkeypatch.setenv("COLUMNS", "200")

    def net(*words: str) -> tuple[int, str, str]:
        return call("net", *words)

    return net


@pytest.fixture
def bridge() -> Iterator[Running]:
    with running_bridge(forward=NORMAL, feedback=LOSSY) as made:
        yield made


@pytest.mark.live
def test_a_running_emulator_is_shown_changed_and_reset(bridge: Running, tis: Tis) -> None:
    where = ("-e", bridge.endpoint)
    code, out, _ = tis("set", "both", "delay.mean_ms=40", "delay.std_ms=1", "--for", "1h", *where)
    assert code == 0
    assert re.search(r"forward \(west to east\): in force from .* until .*: delay normal mean_ms 40 std_ms 1\n", out)
    assert "feedback (east to west): in force from" in out
    assert tis("set", "forward", "loss.p_loss=0.05", "outage=false", *where)[0] == 0
    code, out, _ = tis("outage", "20s", "--direction", "feedback", "--json", *where)
    done = Acknowledgement.model_validate_json(out)
    assert code == 0
    assert [(one.direction, (one.until_ns or 0) - one.from_ns) for one in done.held] == [("feedback", 20 * 10**9)]

    code, out, _ = tis("show", *where)
    assert code == 0
    assert "forward (west to east)" in out
    words = " ".join(out.split())
    assert "delay normal mean_ms 40 std_ms 1 * normal mean_ms 40 std_ms 1 *" in words
    assert "loss bernoulli p_loss 0.05 * bernoulli p_loss 0.1 " in words
    assert "outage no yes" in words
    assert "for 3600 s: delay normal mean_ms 40 std_ms 1" in words
    assert "changed, feedback: from" in words

    code, out, _ = tis("reset", "--json", *where)
    assert Acknowledgement.model_validate_json(out).accepted
    state = EmulatorState.model_validate_json(tis("show", "--json", *where)[1])
    assert state.forward is not None
    assert state.forward.added == ()


@pytest.mark.live
@pytest.mark.parametrize(
    "words",
    [["set", "forward", "delay.mean_ms=40"], ["set", "--profile", "geo_satellite"], ["outage", "1s"], ["reset"]],
)
def test_what_is_changed_is_named(
    bridge: Running, tis: Tis, words: list[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    code, out, _ = tis(*words, "-e", bridge.endpoint)
    assert code == 0
    assert out.startswith(f"{bridge.endpoint}, tis: accepted at ")
    found = [running.Running(bridge.endpoint, session="tis", title="tis run demo")]
    monkeypatch.setattr(emulator_client, "sessions", lambda: found)
    assert tis(*words)[1].startswith(f"{bridge.endpoint}, tis (tis run demo): accepted at ")
    assert tis("show")[1].startswith(f"{bridge.endpoint}, tis (tis run demo): run time ")


@pytest.mark.live
def test_a_permanent_change_replaces_only_the_stages_that_it_names_as_the_help_says(
    bridge: Running, tis: Tis
) -> None:
    where = ("-e", bridge.endpoint)
    for setting in ("delay.mean_ms=40", "loss.p_loss=0.05", "loss.p_loss=0.07"):
        assert tis("set", "forward", setting, *where)[0] == 0
    now = json.loads(tis("show", "--json", *where)[1])["forward"]["now"]
    assert (now["delay"]["mean_ms"], now["loss"]["p_loss"]) == (40, 0.07)
    assert "replaces only what it names" in " ".join(tis("set", "--help")[1].split())


@pytest.mark.live
def test_a_profile_is_looked_up_here(bridge: Running, tis: Tis) -> None:
    where = ("-e", bridge.endpoint)
    assert tis("set", "forward", "scale_delay=2", "--for", "1h", *where)[0] == 0
    code, out, _ = tis("set", "--profile", "geo_satellite", *where)
    assert code == 0
    assert "earlier changes end at" in out
    forward = json.loads(tis("show", "--json", *where)[1])["forward"]
    assert forward["now"]["delay"] != forward["pipeline"]["delay"]
    assert forward["scale_delay"] == 1
    code, _, err = tis("set", "--profile", "starlink_2022_eu", *where)
    assert code == 2
    assert "profile: must be a static network to apply it during a run; this one has states: start netem" in err
    assert tis("set", "--profile", "nowhere", *where)[0] == 2


@pytest.mark.live
def test_a_refusal_is_one_line_for_each_fault(bridge: Running, tis: Tis) -> None:
    code, out, err = tis("outage", "25h", "-e", bridge.endpoint)
    assert (code, out, err) == (2, "", "tis: netem: for_ms: must be at most 8.64e+07 (got 90000000.0)\n")
    code, out, err = tis("set", "forward", "scale_delay=2", "--ramp", "2s", "--for", "1s", "-e", bridge.endpoint)
    assert (code, err) == (2, "tis: netem: 0: ramp_s must be at most half of for_s = 1.0\n")


@pytest.mark.parametrize(
    ("words", "fault"),
    [
        (["set", "west", "outage=true"], "direction: must be one of both, forward, feedback (got 'west')"),
        (["set", "forward"], "must read: tis net set forward|feedback|both a.b=VALUE"),
        (["set", "forward", "--profile", "x"], "--profile: must be given alone"),
        (["outage", "soon"], "SECONDS: must be a duration in s"),
        (["outage", "1s", "--direction", "up"], "direction: must be one of both, forward, feedback (got 'up')"),
        (["show", "--prefix", "a/**"], "--prefix: must be a single chunk of a key, such as tis"),
        (
            ["set", "forward", "network.forward.delay.delay_ms=3"],
            "network.forward.delay.delay_ms: must begin with the stage, did you mean 'delay.delay_ms'?",
        ),
        (
            ["set", "both", "feedback.outage=true"],
            "feedback.outage: must begin with the stage, did you mean 'outage'?",
        ),
        (["reset", "-c", "/no/such.json5"], "--config: /no/such.json5: No such file or directory"),
        (["show", "--cfg", "junk"], "--cfg: junk: must read KEY:VALUE"),
        (["show", "-e", "junk"], "--connect: must be PROTOCOL/ADDRESS"),
    ],
)
def test_bad_words_are_refused_before_anybody_is_asked(words: list[str], fault: str, tis: Tis) -> None:
    code, out, err = tis(*words)
    assert (code, out) == (2, "")
    assert fault in err
    assert len(err.splitlines()) == 1


@pytest.mark.live
def test_where_nobody_answers_the_place_is_named(tis: Tis) -> None:
    endpoint, _ = free_endpoints()
    code, _, err = tis("show", "-e", endpoint)
    assert (code, err) == (
        3,
        f"tis: tis net: {endpoint}: cannot connect: nothing listens there, or it refuses this client (-c, --cfg)\n",
    )
    with a_router(endpoint):
        code, _, err = tis("reset", "-e", endpoint, "--prefix", "lab")
    assert (code, err) == (
        3,
        f"tis: tis net: {endpoint}: connected, but nothing answers on lab/netem/control/reset: "
        "there is no emulator, or it refuses this client: its own warnings say so\n",
    )


@pytest.mark.live
def test_where_an_emulator_goes_by_another_prefix_it_is_named(bridge: Running, tis: Tis) -> None:
    code, _, err = tis("outage", "1s", "-e", bridge.endpoint, "--prefix", "lab")
    assert (code, err) == (
        3,
        f"tis: tis net: {bridge.endpoint}: connected, but nothing answers on lab/netem/control/outage: use --prefix "
        "tis\n",
    )
    assert not bridge.bridge.in_outage("forward")


@pytest.mark.live
def test_zenoh_s_own_options_lead_to_a_network_that_asks_for_a_password(tis: Tis, tmp_path: Path) -> None:
    endpoint, _ = free_endpoints()
    users, file = tmp_path / "users.txt", tmp_path / "netem.json5"
    users.write_text("lab:secret")
    auth = {"user": "lab", "password": "secret", "dictionary_file": str(users)}
    # a file that netem could have, too: what it says of listening is not for a client
    content = {"mode": "router", "transport": {"auth": {"usrpwd": auth}}, "listen": {"endpoints": [endpoint]}}
    file.write_text(json.dumps(content))
    to_connect = f'connect/endpoints:["{endpoint}"]'
    with open_router(configure("router", ZenohOptions(config=file)), endpoint):
        assert "cannot connect" in tis("show", "-e", endpoint)[2]
        for words in (("-c", str(file), "-e", endpoint), ("-c", str(file), "--cfg", to_connect)):
            code, _, err = tis("show", *words)
            assert code == 3
            assert f"{endpoint}: connected, but nothing answers" in err


def test_a_delay_by_points_is_shown_with_what_they_come_to_and_a_way_past_netem_below() -> None:
    """Oracle: between the points the quantiles are straight lines, so the mean is 0.9 x 10 + 0.1 x 30."""
    points = [{"p": 0, "delay_ms": 0}, {"p": 0.9, "delay_ms": 20}, {"p": 1, "delay_ms": 40}]
    delay = {"delay": {"kind": "quantiles", "points": points}}
    way = {"pipeline": delay, "now": delay, "counters": {}, "outage": False, "rules": [], "added": []}
    way |= {"scale_delay": 1, "add_delay_ms": 0, "add_p_loss": 0}
    state = EmulatorState.model_validate({"running": True, "forward": way, "feedback": way})
    assert notes_on(state) == []
    assert notes_on(state.model_copy(update={"counters": {"leaks": 2}})) == ["2 ways past netem found: not valid"]
    rows = {row[0]: row[1] for row in state_table(state).rows}
    assert rows["delay"] == "quantiles points (3 points) (mean 12, p50 11.1, p99 38 ms)"
