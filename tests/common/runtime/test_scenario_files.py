"""Files of any size, read up to a limit."""

import os
import re
import shlex
from pathlib import Path
from typing import Any

import pytest

from tis.common.errors import DataError, InputError
from tis.common.runtime.scenario_files import load_traces, read_limited, read_scenario, trace_attachments
from tis.common.scenario.network import NetworkPart
from tis.common.scenario.network.pipeline import Stages
from tis.common.trace import OpportunityTrace


def test_a_file_up_to_the_limit_is_read(tmp_path: Path) -> None:
    (tmp_path / "a").write_bytes(b"abc")
    assert read_limited(tmp_path / "a", 3) == b"abc"
    with pytest.raises(OSError, match="it has more than 2 bytes"):
        read_limited(tmp_path / "a", 2)


def test_an_endless_device_is_refused() -> None:
    with pytest.raises(InputError, match="/dev/zero: cannot be read: it has more than 4000000 bytes"):
        read_scenario(Path("/dev/zero"))


GOOD = "sent_s,delay_ms\n0,1\n"


def _delay(path: Path | str) -> dict[str, Any]:
    return {"kind": "trace", "path": str(path)}


def _network(folder: Path) -> NetworkPart:
    """A network that names a file in every place that can name one."""
    names = [f"{number}.csv" for number in range(8)]
    for name in names:
        (folder / name).write_text(GOOD.replace("0,1", f"0,{name[0]}"))
    paths = [folder / name for name in names]
    return NetworkPart.model_validate(
        {
            "forward": {"delay": _delay(paths[0]), "loss": _delay(paths[1])},
            "feedback": {"delay": _delay(paths[0]), "loss": _delay(paths[2])},
            "rules": [{"key": "*/x", "direction": "forward", "pipeline": {"delay": _delay(paths[3])}}],
            "states": {
                "kind": "cycle",
                "states": [
                    {"name": "a", "for_s": 1, "forward": {"delay": _delay(paths[4])}},
                    {"name": "b", "for_s": 1, "feedback": {"loss": _delay(paths[5])}},
                ],
            },
            "timeline": [
                {"at_s": 1, "set": {"delay": _delay(paths[6])}},
                {"at_s": 2, "set": {"loss": _delay(paths[7])}},
            ],
        }
    )


def test_every_trace_that_is_named_anywhere_is_read(tmp_path: Path) -> None:
    traces = load_traces(_network(tmp_path))
    assert {path: int(trace.delay_ns[0]) for path, trace in traces.items()} == {
        str(tmp_path / f"{number}.csv"): number * 1_000_000 for number in range(8)
    }
    assert load_traces(NetworkPart()) == {}


def test_recorded_opportunities_are_read_in_their_own_format(tmp_path: Path) -> None:
    path = tmp_path / "cell.up"
    path.write_text("1\n3\n")
    stages = Stages.model_validate({"rate": {"opportunities": str(path)}})
    trace = load_traces(stages)[str(path)]
    assert isinstance(trace, OpportunityTrace)
    assert trace.sent_ns.tolist() == [1_000_000, 3_000_000]
    assert list(trace_attachments(stages).values()) == [b"1\n3\n"]
    # one file cannot be both
    both = Stages.model_validate({"rate": {"opportunities": str(path)}, "delay": _delay(path)})
    with pytest.raises(DataError, match="must name the columns"):
        load_traces(both)


def test_a_path_counts_from_the_working_folder_and_is_the_key_as_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "a.csv").write_text(GOOD)
    monkeypatch.chdir(tmp_path)
    assert list(load_traces(Stages.model_validate({"delay": _delay("./a.csv")}))) == ["./a.csv"]


def test_the_faults_of_all_files_come_at_once(tmp_path: Path) -> None:
    (tmp_path / "0.csv").write_text("sent_s,delay_ms\n0,-1\n1,x\n")
    (tmp_path / "1.csv").write_bytes(b"sent_s,delay_ms\n0,1\xff\n")
    (tmp_path / "2.csv").mkdir()
    network = NetworkPart.model_validate(
        {
            "forward": {"delay": _delay(tmp_path / "0.csv"), "loss": _delay(tmp_path / "1.csv")},
            "feedback": {"delay": _delay(tmp_path / "2.csv"), "loss": _delay(tmp_path / "3.csv")},
        }
    )
    with pytest.raises(DataError) as caught:
        load_traces(network)
    lines = [line.removeprefix(f"{tmp_path}/") for line in str(caught.value).split("\n")]
    assert lines == [
        "0.csv: line 2: delay_ms must be between 0 and 3600000 (got -1.0)",
        "0.csv: line 3: must be two finite numbers, sent_s,delay_ms, the second empty where lost (got '1,x')",
        "1.csv: must be UTF-8; byte 19 is not",
        "2.csv: must be a file",
        "3.csv: does not exist",
    ]


def test_a_file_that_is_far_too_large_is_not_read(tmp_path: Path) -> None:
    with (tmp_path / "0.csv").open("wb") as file:
        file.truncate(256_000_001)  # sparse: it takes no room
    stages = Stages.model_validate({"delay": _delay(tmp_path / "0.csv")})
    with pytest.raises(DataError, match=re.escape("must have at most 256000000 bytes (got 256000001)")):
        load_traces(stages)


def test_a_path_that_no_file_can_have_is_refused() -> None:
    with pytest.raises(DataError, match=r"x: (does not exist|cannot be read)"):
        load_traces(Stages.model_validate({"delay": _delay("a\x00x")}))
    with pytest.raises(DataError, match="cannot be read: File name too long"):
        load_traces(Stages.model_validate({"delay": _delay("a" * 5000)}))


def test_what_a_run_kept_is_read_after_its_files_have_changed_or_gone(tmp_path: Path) -> None:
    network = _network(tmp_path)
    kept, traces = trace_attachments(network), load_traces(network)
    (tmp_path / "0.csv").unlink()
    (tmp_path / "1.csv").write_text(GOOD)
    again = load_traces(network, kept)
    assert {path: trace.delay_ns.tolist() for path, trace in again.items()} == {
        path: trace.delay_ns.tolist() for path, trace in traces.items()
    }
    with pytest.raises(DataError, match="does not exist"):
        load_traces(network)


_POSES = "1403636580.5 0.1 0.2 0.3 0 0 0 1\n"
_MAKES = "makes a table of it, and "


@pytest.mark.parametrize(
    ("name", "text", "what", "makes"),
    [
        ("a.csv", "time_s,x\n", "table", ""),
        ("a.PARQUET", "PAR1", "table", ""),
        ("a.bag", "", "recording", _MAKES),
        ("data.csv", "#timestamp [ns],p_RS_R_x [m],p_RS_R_y [m],p_RS_R_z [m]\n", "trajectory (EuRoC)", _MAKES),
        ("stamped groundtruth.txt", f"# timestamp tx ty tz qx qy qz qw\n{_POSES * 99}", "recording", _MAKES),
    ],
)
def test_a_recording_that_is_no_scenario_is_named_with_the_command_that_reads_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, text: str, what: str, makes: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path(name).write_text(text)
    with pytest.raises(InputError) as caught:
        read_scenario(Path(name))
    command = shlex.join(["tis", "import", name, "--out", f"{Path(name).stem}_table.csv"])
    assert str(caught.value) == f"{name}: is a {what}, not a scenario: `{command}` {makes}tells how to play it"


def test_a_scenario_may_come_through_a_pipe() -> None:
    """Its first bytes are read once."""
    end, start = os.pipe()
    os.write(start, b"version: 1\n")
    os.close(start)
    try:
        assert read_scenario(Path(f"/dev/fd/{end}")) == {"version": 1}
    finally:
        os.close(end)
