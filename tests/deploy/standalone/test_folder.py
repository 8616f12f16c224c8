"""`tis info`, `tis summarize` and `tis report` on what a standalone netem left: a log that the models drew."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from typer.testing import CliRunner

from tests.deploy.report.hand_made import MS, counter, fate, ints, release, write_log
from tests.deploy.report.partial import causes
from tis.common.errors import EXIT_INVALID_RUN, EXIT_LOSSY_RECOVERY, EXIT_OK, DataError
from tis.common.node import Record
from tis.common.records import CONTROL, FATES, RELEASES, ControlNote, Departure, FateBatch, Outcome, ReleaseBatch
from tis.common.runtime.scenario_files import load_traces, trace_attachments
from tis.common.scenario.network import NetworkPart
from tis.deploy.cli.main import app
from tis.deploy.shell import run_dir as folder
from tis.deploy.standalone.command import close_folder
from tis.deploy.standalone.standalone_run import is_standalone, load_standalone
from tis.netem.bridge.standalone_log import network_yaml
from tis.netem.expected.simulate import simulate

N = 2000
KEY = "demo/pose"
NETWORK: dict[str, Any] = {
    "from_profile": "mine",
    "forward": {
        "delay": {"kind": "gamma", "shift_ms": 20, "mean_ms": 10, "std_ms": 5},
        "loss": {"kind": "bernoulli", "p_loss": 0.05},
        "ordering": "reorder",  # `simulate` leaves the order to the delays
    },
    "timeline": [{"at_s": 4, "for_s": 1, "direction": "forward", "set": {"outage": True}}],
}
ABOUT = {
    "mode": "live", "seed": "7", "keys": "demo/**\nother/*", "begun": "2026-01-02T03:04:05+00:00",
    "command": "tis netem 'demo/**'", "tis-testbed": "9.8.7",
}  # fmt: skip


def _network(raw: dict[str, Any] = NETWORK) -> NetworkPart:
    return NetworkPart.model_validate(raw)


def _records(network: NetworkPart, later_ms: float = 0.0, error_ns: int = 1000) -> list[Record]:
    """What netem logs of 2000 foreign messages, 10 ms apart; the delays are ``later_ms`` longer than drawn."""
    offered_ns = np.arange(N) * 10 * MS
    drawn = simulate(network, "forward", 7, offered_ns, 100, load_traces(network), KEY)
    through = ~drawn.lost
    delay_ns = (drawn.delay_ns + round(later_ms * MS)) * through
    left_ns = offered_ns + delay_ns
    outcomes: tuple[Outcome, ...] = tuple(
        "outage" if out else "loss" if lost else "deliver" for out, lost in zip(drawn.outage, drawn.lost, strict=True)
    )
    fates = FateBatch(
        direction="forward", key=KEY, foreign=True, seq=tuple(range(N)), offered_ns=ints(offered_ns),
        outcome=outcomes, delay_ns=ints(delay_ns), release_ns=ints(left_ns * through), n_bytes=(100,) * N,
        copies=(0,) * N, flipped=(0,) * N,
    )  # fmt: skip
    seq = np.flatnonzero(through)
    departures: tuple[Departure, ...] = ("released",)
    releases = ReleaseBatch(
        direction="forward", key=KEY, foreign=True, seq=ints(seq), copy_index=(0,) * len(seq),
        offered_ns=ints(offered_ns[seq]), release_ns=ints(left_ns[seq]),
        released_ns=ints(left_ns[seq] + error_ns), departure=departures * len(seq), queued_ns=(0,) * len(seq),
    )  # fmt: skip
    counts = {"forward.offered": N, "forward.copied": 0, "forward.released": len(seq), "forward.held_at_end": 0}
    return [
        Record(FATES, 0, fates),
        Record(RELEASES, N * 10 * MS, releases),
        *(counter(*one) for one in counts.items()),
    ]


def _left(run_dir: Path, raw: dict[str, Any] = NETWORK, later_ms: float = 0.0, more: tuple[Record, ...] = ()) -> Path:
    """Write what a killed netem leaves: its log alone."""
    network = _network(raw)
    files = {"network.yaml": network_yaml(network).encode(), **trace_attachments(network)}
    run_dir.mkdir(exist_ok=True)
    write_log(run_dir, "netem", [*_records(network, later_ms), *more], ABOUT, files)
    return run_dir


def _tis(*words: str) -> tuple[int, str]:
    """Return the exit code and all that was said, in one line whatever the width."""
    result = CliRunner().invoke(app, list(words))
    assert "Traceback" not in result.output
    return result.exit_code, " ".join(result.output.split())


def _summary(run_dir: Path) -> dict[str, Any]:
    content: dict[str, Any] = json.loads((run_dir / "summary.json").read_text())
    return content


def test_a_summary_holds_what_was_asked_decided_and_realised_and_the_verdict(tmp_path: Path) -> None:
    run_dir = _left(tmp_path)
    code, out = _tis("summarize", str(run_dir))
    assert code == EXIT_OK
    assert "forward (west to east): faithful to the request" in out
    summary = _summary(run_dir)
    link = summary["links"]["forward"]
    assert summary["valid"]
    assert (summary["seed"], summary["keys"], summary["profile"]) == (7, ["demo/**", "other/*"], "mine")
    assert summary["begun"] == "2026-01-02T03:04:05+00:00"
    assert link["offered"] == N
    assert link["dropped_by"]["outage"] == 100
    assert link["released"] + link["dropped"] == N
    assert link["requested"]["loss_pct"] == pytest.approx(5)
    assert link["delay_ms"]["requested"]["mean"] == pytest.approx(30)
    assert link["delay_ms"]["decided"]["mean"] == pytest.approx(30, abs=0.5)
    assert link["delay_ms"]["realised"]["mean"] - link["delay_ms"]["decided"]["mean"] == pytest.approx(1e-3, abs=1e-6)
    assert link["verdict"]["faithful"]
    assert link["conditions"]["outage_s"] == 1
    assert link["sent"] is link["received"] is link["unplanned_loss"] is None  # only others' logs would tell
    assert list(link["keys"]) == [KEY]
    assert summary["links"]["feedback"]["verdict"]["faithful"] is None


def test_what_was_not_asked_for_is_not_faithful(tmp_path: Path) -> None:
    run_dir = _left(tmp_path, later_ms=2)
    code, out = _tis("summarize", str(run_dir))
    assert code == EXIT_OK  # it was measured well
    assert "not faithful to the request" in out
    assert f"{KEY}: decided delay: " in out
    assert not _summary(run_dir)["links"]["forward"]["verdict"]["faithful"]


def test_a_way_past_netem_and_a_false_count_are_no_valid_measurement(tmp_path: Path) -> None:
    run_dir = _left(tmp_path, more=(counter("leaks", 2),))
    assert _tis("summarize", str(run_dir))[0] == EXIT_INVALID_RUN
    assert causes(_summary(run_dir)["problems"]) == ["2 ways past netem were found: messages crossed without it"]
    network = _network()
    false = [record for record in _records(network) if record.topic != RELEASES]
    write_log(tmp_path, "netem", false, ABOUT, {"network.yaml": network_yaml(network).encode()})
    assert _tis("summarize", str(run_dir))[0] == EXIT_INVALID_RUN
    assert "links.forward: netem counted" in _summary(run_dir)["problems"][0]


def test_one_way_past_netem_is_one(tmp_path: Path) -> None:
    run_dir = _left(tmp_path, more=(counter("leaks", 1),))
    assert _tis("summarize", str(run_dir))[0] == EXIT_INVALID_RUN
    assert causes(_summary(run_dir)["problems"]) == ["1 way past netem was found: messages crossed without it"]


def test_messages_with_and_without_a_header_of_ours_on_one_key_all_count(tmp_path: Path) -> None:
    """As the probe does: what warms it up is numbered by netem from 0 on, as are those that count by the probe."""
    network = _network({})
    records: list[Record] = []
    for seq in range(3):
        records += [fate(KEY, seq, 10 * seq, 0, foreign=True), release(KEY, seq, 10 * seq, 0, 10 * seq, foreign=True)]
    for seq in range(20):
        at_ms = 100 + 10 * seq
        records += [fate(KEY, seq, at_ms, 0), release(KEY, seq, at_ms, at_ms, at_ms)]
    records += [counter(f"forward.{name}", n) for name, n in {"offered": 23, "released": 23}.items()]
    write_log(tmp_path, "netem", records, ABOUT, {"network.yaml": network_yaml(network).encode()})
    assert _tis("summarize", str(tmp_path))[0] == EXIT_OK
    link = _summary(tmp_path)["links"]["forward"]
    assert (link["offered"], link["released"], link["foreign"], link["loss_pct"]) == (23, 23, 0, 0)
    assert link["reordered_in_netem"] == 0
    assert {name: key["offered"] for name, key in link["keys"].items()} == {
        KEY: 20, f"{KEY} (without a header of tis)": 3,
    }  # fmt: skip


def test_what_a_full_buffer_dropped_is_no_faithful_network(tmp_path: Path) -> None:
    dropped = [fate(KEY, N + k, 10 * (N + k), None, "overflow", foreign=True) for k in range(5)]
    more = (*dropped, counter("forward.most_held", 20))
    run_dir = _left(tmp_path, NETWORK | {"buffer": {"max_mb": 20}}, more=more)
    out = _tis("summarize", str(run_dir))[1]
    assert "forward (west to east): not faithful to the request" in out
    assert f"{KEY}: buffer of 20 MB full: 5 messages dropped of 2005 offered" in out
    assert re.search(r"dropped because of overflow +5\b", out)


def test_the_folder_is_completed_and_its_network_can_be_used_again(tmp_path: Path) -> None:
    run_dir = _left(tmp_path)
    assert is_standalone(run_dir)
    close_folder(run_dir, _network(), 5)
    assert _network(yaml.safe_load((run_dir / "network.yaml").read_text())) == _network()
    manifest = folder.read_json(run_dir / "manifest.json")
    assert manifest is not None
    assert set(manifest["sha256"]) == {"netem.mcap", "network.yaml"}
    assert manifest["exit_codes"] == {"netem": 5}
    _tis("summarize", str(run_dir))
    again = folder.read_json(run_dir / "manifest.json")
    assert again is not None
    assert (again["command"], again["exit_codes"]) == (ABOUT["command"], {"netem": 5})
    assert (_summary(run_dir)["command"], _summary(run_dir)["exit"]) == (ABOUT["command"], 5)
    assert _summary(run_dir)["versions"] == {"tis-testbed": "9.8.7"}


def test_a_killed_one_has_its_network_in_its_log(tmp_path: Path) -> None:
    run_dir = _left(tmp_path)
    assert not (run_dir / "network.yaml").exists()
    assert load_standalone(run_dir).request.network == _network()
    _tis("summarize", str(run_dir))
    assert {path.name for path in run_dir.iterdir()} == {
        "netem.mcap", "network.yaml", "summary.json", "manifest.json",
    }  # fmt: skip
    content = (run_dir / "netem.mcap").read_bytes()
    (run_dir / "netem.mcap").write_bytes(content[: len(content) * 2 // 3])
    assert _tis("summarize", str(run_dir))[0] == EXIT_INVALID_RUN
    assert "netem: log is damaged" in _summary(run_dir)["problems"][0]
    code, out = _tis("info", str(run_dir))
    assert code == DataError.exit_code
    code, out = _tis("report", str(run_dir))
    assert code == EXIT_LOSSY_RECOVERY
    assert "not valid: netem: log is damaged" in out


def test_info_says_what_was_asked_and_the_state_of_the_log(tmp_path: Path) -> None:
    run_dir = _left(tmp_path)
    close_folder(run_dir, _network(), 0)
    code, out = _tis("info", str(run_dir))
    assert code == EXIT_OK
    for words in (
        "forward (west to east): delay 30 ms",
        "demo/**, other/*, profile mine",
        "begun 2026-01-02",
        "complete",
    ):
        assert words in out
    assert not (run_dir / "summary.json").exists()


def test_the_report_has_the_links_and_nothing_of_an_arm(tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    run_dir = _left(tmp_path)
    close_folder(run_dir, _network(), 0)
    code, out = _tis("report", str(run_dir))
    assert (code, out.strip()) == (EXIT_OK, f"Report: {run_dir / 'report.html'}")
    page = (run_dir / "report.html").read_text()
    assert "west to east" in page
    assert "surgeon to patient" not in page
    for words in ("valid measurement", "delay 30 ms", KEY, "How the delays are distributed", "9.8.7"):
        assert words in page
    assert "Truth and estimates" not in page


def _live(number: int, operation: str, request: str, *added: dict[str, Any]) -> Record:
    at_ns = (10 + number) * 1000 * MS
    note = ControlNote(
        at_ns=at_ns - MS,
        applied_ns=at_ns,
        operation=operation,
        request=request,
        added=json.dumps(added),
        accepted=True,
    )
    return Record(CONTROL, note.at_ns, note)


def _slower(number: int) -> Record:
    change = {"delay": {"kind": "constant", "delay_ms": 200.0}}
    return _live(number, "set", "", {"at_s": 10.0 + number, "for_s": 0.5, "direction": "forward", "set": change})


def test_each_change_made_while_it_ran_stands_in_words_and_is_not_repeated(tmp_path: Path) -> None:
    pytest.importorskip("bokeh")
    whole = ({"at_s": 11.0, "direction": way, "set": {"clean": True}} for way in ("forward", "feedback"))
    more = (_slower(0), _live(1, "profile", '{"profile": "wifi_bad", "netw...', *whole), _live(2, "reset", "{}"))
    run_dir = _left(tmp_path / "few", more=more)
    out = _tis("info", str(run_dir))[1]
    _tis("report", str(run_dir))
    page = (run_dir / "report.html").read_text()
    for words in (
        "changed while running: forward, from 10.000 s for 0.5 s: delay 200 ms",
        "changed while running: both directions, from 11.000 s: profile wifi_bad, in place of what was set before",
        "changed while running: both directions, from 12.000 s: reset to what was asked for at the start",
    ):
        assert words in out
        assert words in page
    assert "Changes made while it ran are not repeated" in page
    many = _left(tmp_path / "many", more=tuple(map(_slower, range(9))))
    assert "and 3 more changes while running" in _tis("info", str(many))[1]


def test_its_packets_are_exported_as_tables(tmp_path: Path) -> None:
    run_dir = _left(tmp_path / "run")
    assert _tis("export", str(run_dir), "--csv")[0] == EXIT_OK
    files = {path.name for path in (run_dir / "export").iterdir()}
    assert files == {"README.md", "fates.csv", "releases.csv", "netem_counters.csv"}
    fates = (run_dir / "export" / "fates.csv").read_text().splitlines()
    assert len(fates) == 1 + N
    assert sum("outage" in row for row in fates) == 100
    assert "netem between two networks, seed 7" in (run_dir / "export" / "README.md").read_text()
    code, out = _tis("export", str(run_dir), "--jigsaws", "--out", str(tmp_path / "j"))
    assert (code, "--jigsaws: needs the logs of surgeon and patient" in out) == (2, True)


def test_its_figures_are_those_of_the_network_and_it_is_compared_with_no_run(tmp_path: Path) -> None:
    pytest.importorskip("matplotlib")
    run_dir = _left(tmp_path / "run")
    assert _tis("report", str(run_dir), "--figures", str(tmp_path / "f"), "--format", "svg")[0] == EXIT_OK
    assert {path.name for path in (tmp_path / "f").iterdir()} == {"delay.svg", "delay_cdf.svg", "loss_runs.svg"}
    code, out = _tis("report", "--compare", str(run_dir), str(tmp_path))
    assert (code, "is the folder of a standalone netem" in out) == (DataError.exit_code, True)


def test_a_trace_is_taken_from_the_log(tmp_path: Path) -> None:
    trace = tmp_path / "t.csv"
    trace.write_text("sent_s,delay_ms\n" + "".join(f"{i / 10},{20 + i}\n" for i in range(5000)))
    run_dir = _left(tmp_path / "run", {"forward": {"delay": {"kind": "trace", "path": str(trace)}}})
    trace.unlink()
    assert _tis("summarize", str(run_dir))[0] == EXIT_OK
    link = _summary(run_dir)["links"]["forward"]
    assert link["verdict"]["faithful"]
    assert link["delay_ms"]["requested"]["mean"] == pytest.approx(20 + (N - 1) / 2)


def test_a_run_of_the_testbed_is_none_and_an_empty_folder_neither(tmp_path: Path) -> None:
    assert not is_standalone(tmp_path)
    write_log(tmp_path, "netem", [], {}, {"scenario.yaml": b"{}"})
    assert not is_standalone(tmp_path)
    _left(tmp_path)
    folder.write(tmp_path / "scenario.yaml", "version: 1")
    assert not is_standalone(tmp_path)
    (tmp_path / "scenario.yaml").unlink()
    write_log(tmp_path, "surgeon", [])
    assert not is_standalone(tmp_path)
    (tmp_path / "surgeon.mcap").unlink()
    (tmp_path / "netem.mcap").write_bytes(b"junk")
    assert not is_standalone(tmp_path)
    assert _tis("summarize", str(tmp_path))[0] == 4
