"""``tis net``: what it prints, what it writes, what a mistake gets."""

import io
import json
from pathlib import Path

import numpy as np
import pytest
import zenoh
from rich.console import Console

from tests.deploy.commands import Call, call
from tis.common.runtime.ports import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_router
from tis.common.trace import Trace, parse_trace, render_trace
from tis.deploy.net.fit import cautions
from tis.deploy.net.library import list_profiles
from tis.deploy.net.profiles import find_profile, shipped_names
from tis.netem.fit.closure import Closure
from tis.netem.fit.direction import fit_direction
from tis.netem.fit.half_life import HalfLife
from tis.netem.fit.record import DirectionRecord


@pytest.fixture
def tis(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Call:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("COLUMNS", "200")

    return call


def write_trace(path: str, n: int = 2000) -> None:
    rng = np.random.default_rng(1)
    delay_ns = np.rint((5 + rng.gamma(3, 2, n)) * 1e6).astype(np.int64)
    delay_ns[rng.random(n) < 0.05] = -1
    sent_ns = np.arange(n, dtype=np.int64) * 10_000_000
    Path(path).write_text(render_trace(Trace(path, sent_ns, delay_ns, {"host": "bench", "clock": "one"})))


def test_the_library_is_listed_with_what_it_amounts_to(tis: Call) -> None:
    code, out, _ = tis("net", "profiles")
    assert code == 0
    assert all(name in out for name in shipped_names())
    line = next(line for line in out.splitlines() if line.startswith("netfi_clm_2"))
    assert "33.33" in line


def test_a_narrow_terminal_has_the_titles_as_well() -> None:
    out = Console(file=io.StringIO(), width=80)
    with out.capture() as shown:
        list_profiles(out, as_json=False)
    words = set(shown.get().split())
    titles = [find_profile(name).title for name in shipped_names()]
    assert not [title for title in titles if not set(title.split()) <= words]


def test_the_library_as_json(tis: Call) -> None:
    code, out, _ = tis("net", "profiles", "--json")
    assert code == 0
    assert json.loads(out)["netfi_dlm_2"]["figures"]["forward"]["mean_ms"] == pytest.approx(299.2, abs=0.05)


def test_one_profile_shows_every_number_with_source_and_basis(tis: Call) -> None:
    code, out, _ = tis("net", "profiles", "telesurgery_swine_2020")
    assert code == 0
    assert "both.loss.p_loss" in out
    assert "both ways: mean 57 ms" in out
    assert "measured" in out
    assert "Surgical Endoscopy 34:5172" in out
    code, out, _ = tis("net", "profiles", "telesurgery_swine_2020", "--json")
    assert json.loads(out)["network"]["forward"]["delay"]["delay_ms"] == 57


@pytest.mark.parametrize(
    ("words", "code", "line"),
    [
        (("profiles", "geo_satelite"), 2, "did you mean 'geo_satellite'"),
        (("probe",), 2, "tis net probe: --from: is required"),
        (("probe", "--from", "tcp/127.0.0.1:1"), 2, "tis net probe: --to: is required"),
        (("probe", "-e", "tcp/127.0.0.1:1", "-l", "tcp/127.0.0.1:2"), 2, "--listen: must not be given together with"),
        (("probe", "-e", "tcp/127.0.0.1:1", "--count", "5", "--seconds", "2"), 2, "--duration-s: must not be given"),
        (("probe", "-e", "tcp/127.0.0.1:1", "--key", "a/**"), 2, "must be one key, without wildcards"),
        (("probe", "-e", "tcp/127.0.0.1:1", "--key", "a//b"), 2, "--key: must be a Zenoh key"),
        (("probe", "-e", "tcp/127.0.0.1:1", "--wait-s", "0.2"), 3, "no answer within 0.2 s"),
        (("probe", "-e", "tcp/127.0.0.1:1", "-o", "no/where.csv"), 4, "where.csv: cannot be written"),
        (("probe", "--reflector"), 2, "tis net probe: --reflector: requires exactly one of --connect and --listen"),
        (("probe", "--reflector", "-e", "tcp/127.0.0.1:1", "--to", "tcp/127.0.0.1:2"), 2, "and excludes --from"),
        (("reflect",), 2, "tis net reflect: --listen: or --connect is required"),
        (("reflect", "-l", "tcp/127.0.0.1:1", "--key", "a/*"), 2, "tis net reflect: --key: must be one key"),
        (("reflect", "-e", "tcp/127.0.0.1:1", "--wait-s", "0.2"), 3, "reflect: tcp/127.0.0.1:1: no answer"),
        (("fit", "t.csv", "-o", "mine.txt"), 2, "tis net fit: --out: must end in .yaml (got 'mine.txt')"),
        (("fit", "none.csv"), 4, "none.csv: does not exist"),
        (("fit", "."), 4, "is no run folder"),
        (("fit", "x.csv"), 4, "x.csv: line 1"),
        (("fit", "t.csv", "--way", "up"), 2, "--way: must be one of forward, feedback, both"),
        (("fit", "t.csv", "--distribution", "cauchy"), 2, "--distribution: must be one of auto, constant"),
        (("fit", "one.csv"), 4, "one.csv: must have at least 30 messages that arrived, has 1"),
        (("fit", "flat.csv", "--distribution", "gamma"), 4, "a gamma distribution cannot be fitted"),
    ],
)
def test_a_mistake_is_one_line(tis: Call, tmp_path: Path, words: tuple[str, ...], code: int, line: str) -> None:
    write_trace("t.csv")
    Path("x.csv").write_text("hello\n")
    Path("one.csv").write_text("sent_s,delay_ms\n0,1\n1,\n")
    Path("flat.csv").write_text("sent_s,delay_ms\n" + "0,1\n" * 40)
    before = sorted(tmp_path.iterdir())
    got, out, err = tis("net", *words)
    assert got == code
    assert line in err
    assert len(err.strip().splitlines()) == 1
    assert out == ""
    assert sorted(tmp_path.iterdir()) == before


def test_a_fit_is_a_profile_that_a_scenario_takes(tis: Call) -> None:
    write_trace("my link.csv")
    code, out, _ = tis("net", "fit", "my link.csv", "-o", "mine.yaml")
    assert code == 0
    assert "gamma <-" in out
    profile = find_profile("mine.yaml")
    assert profile.name == "mine"
    assert "host: bench" in profile.sources["record"]
    code, out, err = tis("validate", "default", "--set", "network.profile=mine.yaml")
    assert (code, err) == (0, "")
    assert "from_profile: mine" in out


def test_a_fit_that_replaces_a_file_says_so(tis: Call) -> None:
    write_trace("t.csv")
    assert "replaced" not in tis("net", "fit", "t.csv", "-o", "mine.yaml")[1]
    assert "mine.yaml (replaced)" in tis("net", "fit", "t.csv", "-o", "mine.yaml")[1]


def test_a_fit_to_next_to_nothing_says_so_here_and_in_the_profile(tis: Call) -> None:
    write_trace("few.csv", 40)
    code, _, err = tis("net", "fit", "few.csv", "-o", "mine.yaml")
    assert code == 0
    warning = "only 39 messages arrived: a delay fit needs at least 100 to be reliable"
    assert f"warning: both ways: {warning}" in err
    assert warning in find_profile("mine.yaml").notes
    write_trace("t.csv")
    assert tis("net", "fit", "t.csv")[2] == ""


def write_ping(path: str, n: int) -> None:
    every = "[{}] 64 bytes from h: icmp_seq={} ttl=64 time={} ms"
    lines = [every.format(1_700_000_000 + i / 50, i, 20 + i * i % 17) for i in range(1, n + 1) if i % 8]
    Path(path).write_text("\n".join(["PING h (10.0.0.1) 56(84) bytes of data.", *lines]) + "\n")


@pytest.mark.parametrize(("way", "n"), [("forward", 31), ("feedback", 31), ("forward", 10)])
def test_a_ping_that_is_too_short_for_its_varying_way_makes_no_profile(tis: Call, way: str, n: int) -> None:
    """Its other way, the constant half, would inject nothing of what was measured."""
    write_ping("ping.txt", n)
    code, out, err = tis("net", "fit", "ping.txt", "--way", way, "-o", "mine.yaml")
    assert (code, out, Path("mine.yaml").exists()) == (4, "", False)
    assert f"ping.txt: must have at least 30 messages that arrived, has {n - n // 8}" in err
    assert len(err.strip().splitlines()) == 1
    assert "ping -c 200" in err


def test_a_wanted_distribution_leaves_the_constant_half_of_a_ping_as_it_is(tis: Call) -> None:
    write_ping("ping.txt", 200)
    code, _, err = tis("net", "fit", "ping.txt", "--distribution", "gamma", "--replays", "0", "-o", "mine.yaml")
    assert (code, err) == (0, "")
    network = find_profile("mine.yaml").network
    assert [getattr(way.delay, "kind", None) for way in (network.forward, network.feedback)] == ["gamma", "constant"]


def test_a_constant_delay_is_told_from_what_the_machine_added(tis: Call) -> None:
    """25 ms and exponential noise of 0.03 ms; an idle relay is known to vary by as much."""
    noise_ms = np.random.default_rng(1).exponential(0.03, 900)
    rows = "".join(f"{i / 100},{25 + late:.6f}\n" for i, late in enumerate(noise_ms))
    Path("t.csv").write_text(f"# measuring_adds_ms: 0.09 (p95 - p5), 0.2 (max - min)\nsent_s,delay_ms\n{rows}")
    code, out, err = tis("net", "fit", "t.csv", "-o", "mine.yaml")
    assert (code, err) == (0, "")
    assert "taken: constant (varies by 0.0" in out
    assert "correlation: none: the delay is constant" in out
    profile = find_profile("mine.yaml")
    assert profile.network.forward.delay is not None
    assert profile.network.forward.delay.kind == "constant"
    assert profile.network.forward.correlation is None
    assert "no more than the" in next(number.note for number in profile.numbers if number.of == "*.delay")


def test_a_half_life_that_may_be_anything_is_warned_of() -> None:
    half_life = HalfLife(1.0, (0.1, 9.0), 1.0, "")
    record = Trace("t", np.arange(500) * 10**7, np.arange(500) % 7 * 10**6)
    fit = fit_direction(DirectionRecord.of(record))
    assert not any("half-life" in caution for caution in cautions(fit))
    (caution,) = cautions(fit._replace(half_life=half_life))
    assert caution == "the half-life is between 0.1 and 9 s: measure longer"


def test_a_short_record_with_memory_says_that_it_may_have_states() -> None:
    """Slow for a second in every four or so, lossless: 300 messages leave one regime, which forgets too soon."""
    rng, delay_ms, slow = np.random.default_rng(5), [], False
    for _ in range(300):
        slow = rng.random() < (0.95 if slow else 0.02)
        delay_ms.append(12.0 + rng.exponential(40.0 if slow else 3.0))
    record = Trace("t", np.arange(300) * 50 * 10**6, (np.array(delay_ms) * 1e6).astype(np.int64))
    fit = fit_direction(DirectionRecord.of(record))
    missed = Closure("autocorrelation at 0.1 s", 0.8, 0.6, 0.5, 0.9, 1.4)
    assert any("states of the network" in text for text in cautions(fit._replace(closures=(missed,))))
    closed = missed._replace(severity=0.9)
    assert not any("states of the network" in text for text in cautions(fit._replace(closures=(closed,))))


def test_a_fit_as_json(tis: Call) -> None:
    write_trace("t.csv")
    code, out, _ = tis("net", "fit", "t.csv", "--json", "--name", "other", "--way", "feedback")
    found = json.loads(out)
    assert (code, found["profile"], list(found["fits"])) == (0, "other", ["feedback"])


@pytest.mark.live
def test_a_probe_through_a_router_writes_a_trace(tis: Call) -> None:
    endpoint, _ = free_endpoints()
    with open_router(configure("router", ZenohOptions(listen=[endpoint])), endpoint) as router:
        assert isinstance(router, zenoh.Session)
        code, out, err = tis("net", "probe", "-e", endpoint, "--rate-hz", "200", "--count", "100", "-o", "t.csv")
    assert code == 0, err
    trace = parse_trace(Path("t.csv").read_text(), "t.csv")
    assert len(trace.sent_ns) + int(trace.about["skipped"]) == 100
    assert (trace.delay_ns >= 0).sum() == len(trace.sent_ns)
    assert 10_000 < np.median(trace.delay_ns) < 50_000_000
    assert np.median(np.diff(trace.sent_ns)) == pytest.approx(5_000_000, rel=0.2)
    assert (trace.about["clock"], trace.about["from"]) == ("same process, monotonic", endpoint)
    assert "100 messages" in err
    assert "0 lost" in out


@pytest.mark.live
def test_a_probe_that_nobody_forwards_says_so(tis: Call) -> None:
    """Two networks that nothing connects: the receiving end hears nothing."""
    west, east = free_endpoints()
    with open_router(configure("router", ZenohOptions(listen=[west])), west):
        code, _, err = tis("net", "probe", "--from", west, "--listen", east, "--wait-s", "0.5")
    assert code == 3
    assert "no message arrived within 0.5 s" in err
