"""The merged file: every record once, in order of the reference's time; what is drawn, against hand-worked values."""

import itertools
import json
import shutil
from collections import Counter, defaultdict
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap_protobuf.decoder import DecoderFactory
from msgspec.structs import replace

from tests.deploy.report.hand_made import ARM, COMMAND, ESTIMATED, MS, a_scenario
from tests.log_reader import LogReader, cut
from tests.nodes import a_pose
from tis.common.channels import Side
from tis.common.clocks import ClockModel
from tis.common.messages import Quaternion, Vector3, encode
from tis.common.node import Record
from tis.common.records import (
    ESTIMATES,
    FRESH,
    ORIENTATIONS,
    REJECTED,
    TICKS,
    TRUTH,
    EstimateNote,
    FreshNote,
    OrientationNote,
    Rejected,
    TickNote,
    TruthRow,
)
from tis.common.runtime.mcap_log import McapLog
from tis.common.scenario import Scenario
from tis.deploy.logs import log_file, merge
from tis.deploy.logs.merge import Conclusion, merge_logs
from tis.deploy.logs.read.clocks import Clocks
from tis.deploy.logs.read.load import load_run
from tis.deploy.logs.viewer.draw_metrics import line
from tis.deploy.logs.viewer.draw_poses import Truth
from tis.deploy.logs.viewer.drawn import Records, RunTopics
from tis.deploy.report.subjects.tracking import track_of_hand

SIDES: tuple[Side, ...] = ("surgeon", "netem", "patient")
Decoded = dict[str, list[tuple[int, int, Any]]]


class Ahead(ClockModel):
    """A clock that the reference is ahead of by 3 s, and that runs 50 ppm slow."""

    def to_reference_ns(self, own_ns: Any) -> Any:
        return own_ns + 3_000_000_000 + own_ns // 20_000


def _read(path: Path) -> Decoded:
    """Return (log time, publish time, message) by topic, through indexes, protobuf decoded by the package."""
    found: Decoded = defaultdict(list)
    with path.open("rb") as file:
        reader = make_reader(file, validate_crcs=True, decoder_factories=[DecoderFactory()])
        for schema, channel, message in reader.iter_messages():
            assert schema is not None
            decode = DecoderFactory().decoder_for(channel.message_encoding, schema)
            content = json.loads(message.data) if decode is None else decode(message.data)
            found[channel.topic].append((message.log_time, message.publish_time, content))
    return found


def _read_undecoded(path: Path) -> dict[str, list[tuple[int, int, bytes]]]:
    """Return (log time, publish time, bytes of the message) by topic."""
    found: dict[str, list[tuple[int, int, bytes]]] = defaultdict(list)
    with path.open("rb") as file:
        for _, channel, message in make_reader(file, validate_crcs=True).iter_messages():
            found[channel.topic].append((message.log_time, message.publish_time, message.data))
    return found


def _write(run_dir: Path, records: dict[Side, Sequence[Record]]) -> dict[Side, list[Path]]:
    run_dir.mkdir(exist_ok=True)
    for side, its in records.items():
        with McapLog(run_dir / f"{side}.mcap", {"side": side}) as log:
            for k, record in enumerate(its):
                log.record(record)
                if k % 3 == 2:
                    log.flush()
    return {side: [run_dir / f"{side}.mcap"] for side in records}


def _merge(run_dir: Path, records: dict[Side, Sequence[Record]], clocks: Clocks | None = None) -> Decoded:
    topics = RunTopics.of(a_scenario(), {})
    merge_logs(_write(run_dir, records), run_dir / "run.mcap", topics, clocks or {})
    return _read(run_dir / "run.mcap")


def _tick(k: int, at_ns: int) -> Record:
    return Record(TICKS, at_ns, TickNote(tick=k, due_ns=at_ns, begin_ns=at_ns))


def _truth(k: int, x: float) -> Record:
    note = TruthRow(hand="left", index=k, sample_ns=100 * k * MS, position_m=Vector3(x=x, y=0.0, z=0.0))
    return Record(TRUTH, 100 * k * MS, note)


def _estimate(at_ms: int, x: float | None, name: str = "hold") -> Record:
    where = None if x is None else Vector3(x=x, y=0.004, z=0.0)
    note = EstimateNote(tick=0, t_ns=at_ms * MS, hand="left", estimator=name, position_m=where)
    return Record(f"{ESTIMATES}/{name}", at_ms * MS, note)


def test_all_records_are_there_once_in_order_of_time(run_dir: Path) -> None:
    """Oracle: the three logs read one by one with another reader, all messages sorted at once."""
    expected = sorted(
        (message.log_time, f"/{side}/{topic.lstrip('/')}", message.publish_time, message.sequence, message.data)
        for side in SIDES
        for topic, message in LogReader(run_dir / f"{side}.mcap").messages()
    )
    found, times = [], []
    for topic, message in LogReader(run_dir / "run.mcap").messages():
        times.append(message.log_time)
        if topic.startswith(tuple(f"/{side}/" for side in SIDES)):
            found.append((message.log_time, topic, message.publish_time, message.sequence, message.data))
    assert sorted(found) == expected
    assert [entry[0] for entry in found] == [entry[0] for entry in expected]
    late = sum(later < sooner for sooner, later in itertools.pairwise(times))
    assert late == 0


def test_it_is_indexed_and_holds_what_was_made_of_the_run(run_dir: Path, scenario: Scenario) -> None:
    with (run_dir / "run.mcap").open("rb") as file:
        reader = make_reader(file, validate_crcs=True)
        summary = reader.get_summary()
        attached = {a.name: a.data for a in reader.iter_attachments()}
        metadata = {m.name: m.metadata for m in reader.iter_metadata()}
    assert summary is not None
    assert summary.statistics is not None
    assert summary.chunk_indexes
    assert all(chunk.message_index_offsets for chunk in summary.chunk_indexes)
    for name in ("scenario.yaml", "model.json", "manifest.json", "summary.json"):
        assert attached[name] == (run_dir / name).read_bytes()
    assert metadata["run"]["scenario"] == scenario.name
    assert metadata["run"]["sides"] == "surgeon,netem,patient"
    for schema in summary.schemas.values():
        if schema.encoding == "jsonschema":
            assert b"$ref" not in schema.data
            assert b"anyOf" not in schema.data


def test_the_other_clock_s_stamps_are_moved_to_the_reference_s(tmp_path: Path) -> None:
    """The patient's clock is 3 s behind and 50 ppm slow; what it received was published by the surgeon's."""
    pose = encode(a_pose(sample_ns=40 * MS))
    at_ns = 2_000_000_000
    found = _merge(
        tmp_path / "r",
        {
            "surgeon": [Record(COMMAND, 40 * MS, pose, type(a_pose()), 40 * MS, 7)],
            "patient": [
                Record(COMMAND, 1000, pose, type(a_pose()), 40 * MS, 7),
                Record(ESTIMATED, at_ns, pose, type(a_pose()), at_ns, 1),
                _tick(0, at_ns),
            ],
        },
        {"patient": Ahead()},
    )
    assert [entry[:2] for entry in found[f"/surgeon/{COMMAND}"]] == [(40 * MS, 40 * MS)]
    assert [entry[:2] for entry in found[f"/patient/{COMMAND}"]] == [(3_000_001_000, 40 * MS)]
    moved = at_ns + 3_000_000_000 + 100_000
    assert [entry[:2] for entry in found[f"/patient/{ESTIMATED}"]] == [(moved, moved)]
    assert found["/patient/tis/ticks"][0][0] == moved
    assert found["/metrics/delay/forward"][0][2]["delay_ms"] == pytest.approx(2960.001)


def test_poses_frames_and_errors_are_those_of_the_records(tmp_path: Path) -> None:
    """Truth goes from x = 0 to 10 mm in 100 ms: at 50 ms an estimate of (2, 4, 0) mm is 5 mm off."""
    found = _merge(
        tmp_path / "r",
        {
            "surgeon": [
                Record(ARM, 0, encode(a_pose(0.25, -0.5, 0.125)), type(a_pose()), 0, 0),
                Record(COMMAND, 0, encode(a_pose(0.5)), type(a_pose()), 0, 0),
                *(_truth(k, 0.01 * k) for k in range(4)),
            ],
            "patient": [_estimate(50, 0.002), _estimate(150, None), _estimate(250, 0.025)],
        },
    )
    ((_, _, pose),) = found["/psm"]
    assert (pose.pose.position.x, pose.pose.position.y, pose.pose.position.z) == (0.25, -0.5, 0.125)
    assert pose.pose.orientation.w == 1.0
    assert pose.frame_id == "world"
    assert found["/mtm"][0][2].pose.position.x == 0.5
    frames = {t.child_frame_id: t.translation.x for _, _, message in found["/tf"] for t in message.transforms}
    assert frames == {"psm": 0.25, "mtm": 0.5}
    assert [(at, message["error_mm"]) for at, _, message in found["/metrics/error/hold"]] == [
        (50 * MS, 5.0),
        (250 * MS, 4.0),
    ]
    assert [message.pose.position.y for _, _, message in found["/estimates/hold"]] == pytest.approx([0.004, 0.004])


def test_estimates_are_drawn_with_the_orientation_of_the_answers_and_its_error(tmp_path: Path) -> None:
    """The arm turns by 40 degrees about z in 100 ms: at 50 ms an orientation of 12 degrees is 8 off."""

    def turned(k: int) -> Record:
        note = _truth(k, 0.0).data
        assert isinstance(note, TruthRow)
        turn = Vector3(x=0.0, y=0.0, z=np.radians(40.0 * k))
        return Record(TRUTH, 100 * k * MS, replace(note, rotation_rad=turn))

    def stated(method: str, degrees: float) -> Record:
        half = np.radians(degrees) / 2
        turn = Quaternion(x=0.0, y=0.0, z=float(np.sin(half)), w=float(np.cos(half)))
        note = OrientationNote(tick=0, t_ns=50 * MS, hand="left", method=method, orientation=turn)
        return Record(f"{ORIENTATIONS}/{method}", 50 * MS, note)

    records = [_estimate(50, 0.002), stated("hold", 0.0), stated("tangent_ls", 12.0)]
    found = _merge(tmp_path / "r", {"surgeon": [turned(k) for k in range(3)], "patient": records})
    ((_, _, pose),) = found["/estimates/hold"]
    assert pose.pose.orientation.z == pytest.approx(np.sin(np.radians(6.0)), abs=1e-6)
    errors = {name: found[f"/metrics/orientation_error/{name}"] for name in ("hold", "tangent_ls")}
    assert [(at, message["error_deg"]) for at, _, message in errors["hold"]] == [(50 * MS, pytest.approx(20.0))]
    assert [(at, message["error_deg"]) for at, _, message in errors["tangent_ls"]] == [(50 * MS, pytest.approx(8.0))]


def test_ages_follow_the_freshest_sample(tmp_path: Path) -> None:
    """Sample of 0 ms used at 40 ms, of 50 ms at 80 ms; nothing new at 120 ms; a missed tick has no age."""

    def fresh(tick: int, at_ms: int, sample_ms: int) -> Record:
        note = FreshNote(tick=tick, hand="left", key=COMMAND, seq=tick, sample_ns=sample_ms * MS)
        return Record(FRESH, at_ms * MS, note)

    missed = Record(TICKS, 160 * MS, TickNote(tick=4, due_ns=160 * MS, begin_ns=170 * MS, missed=True))
    records = [_tick(0, 0), fresh(1, 40, 0), _tick(1, 40 * MS), fresh(2, 80, 50), _tick(2, 80 * MS)]
    found = _merge(tmp_path / "r", {"patient": [*records, _tick(3, 120 * MS), missed]})
    assert [message["age_ms"] for _, _, message in found["/metrics/age"]] == [40.0, 30.0, 70.0]


def test_errors_of_a_run_are_those_that_are_scored(run_dir: Path, scenario: Scenario) -> None:
    """Oracle: the report's own columns, worked out over whole arrays."""
    found, logs = _read(run_dir / "run.mcap"), load_run(run_dir)
    for hand, suffix in (("left", ""), ("right", "/right")):
        track = track_of_hand(logs, scenario, hand)  # type: ignore[arg-type]
        for name, estimate_m in track.estimates.items():
            if name == "plant":
                continue
            error_mm = 1000 * np.linalg.norm(estimate_m - track.truth_m, axis=1)
            expected = {t: e for t, e in zip(track.t_ns.tolist(), error_mm.tolist(), strict=True) if np.isfinite(e)}
            drawn = {at: message["error_mm"] for at, _, message in found[f"/metrics/error/{name}{suffix}"]}
            assert drawn == pytest.approx(expected, abs=1e-4)
            assert len(drawn) > 100


def test_truth_before_a_long_gap_is_not_forgotten_while_estimates_wait_for_it() -> None:
    """Rows of 0 and 1 s, then those of 11 to 20 s at once: truth at 6 s lies midway between those of 1 and 11 s."""
    truth = Truth(RunTopics.of(a_scenario(), {}))
    for seconds in ((0, 1), range(11, 21)):
        at_ns = 1_000_000_000 * np.array(seconds, dtype=np.int64)
        rows = [encode(_truth(k, float(k)).data) for k in seconds]  # type: ignore[arg-type]
        list(truth.take(Records(at_ns, at_ns, np.zeros_like(at_ns), rows)))
    found = truth.at("left", np.array([6_000_000_000, 20_000_000_000]))
    assert found[:, 0].tolist() == [6.0, 20.0]


@pytest.mark.parametrize("at_once", [1, 3000])
def test_it_is_the_same_file_however_much_is_read_at_a_time(
    tmp_path: Path, run_dir: Path, scenario: Scenario, monkeypatch: pytest.MonkeyPatch, at_once: int
) -> None:
    """Oracle: the file that was made in one piece."""
    logs: dict[Side, list[Path]] = {side: [run_dir / f"{side}.mcap"] for side in SIDES}
    topics = RunTopics.of(scenario, {})
    merge_logs(logs, tmp_path / "whole.mcap", topics, {})
    monkeypatch.setattr(log_file, "_GATHERED_BYTES", at_once)
    monkeypatch.setattr(merge, "_MIN_SORTED", at_once)
    merge_logs(logs, tmp_path / "pieces.mcap", topics, {})
    whole, pieces = (_read_undecoded(tmp_path / f"{name}.mcap") for name in ("whole", "pieces"))
    assert {topic: len(messages) for topic, messages in pieces.items()} == {
        topic: len(messages) for topic, messages in whole.items()
    }
    for topic, messages in whole.items():
        assert pieces[topic] == messages, topic


def test_the_conclusion_is_requested_once_everything_before_it_is_written(tmp_path: Path) -> None:
    """Ticks each 0.1 s up to 2 s; the conclusion is of 1 s. It lies behind the tick of 1 s, which it ties with."""
    logs = _write(tmp_path / "r", {"patient": [_tick(k, 100 * k * MS) for k in range(21)]})
    asked = []

    def conclude() -> Conclusion:
        asked.append(1)
        return Conclusion({"summary.json": b"{}"}, (line(1000 * MS, "INFO", "tis", "met"),))

    target, first = tmp_path / "run.mcap", [line(0, "INFO", "tis", "begun")]
    merge_logs(logs, target, RunTopics.of(a_scenario(), {}), {}, first, conclude, 1000 * MS)
    found = _read(target)
    assert asked == [1]
    assert [(at, message.message) for at, _, message in found["/log"]] == [(0, "begun"), (1000 * MS, "met")]
    times = [m.log_time for _, m in LogReader(target).messages()]
    assert times == sorted(times)
    with target.open("rb") as file:
        assert {a.name: a.data for a in make_reader(file).iter_attachments()}["summary.json"] == b"{}"


def test_paths_are_the_last_seconds_once_a_second(run_dir: Path) -> None:
    found = _read(run_dir / "run.mcap")
    paths = found["/paths/truth"]
    assert [at // 1_000_000_000 for at, _, _ in paths] == [1, 2, 3, 4, 5]
    assert [len(message.poses) for _, _, message in paths] == [11, 21, 31, 41, 50]


def test_both_hands_are_drawn_the_first_under_the_plain_names(run_dir: Path) -> None:
    topics = set(_read(run_dir / "run.mcap"))
    for name in ("/mtm", "/psm", "/plant", "/estimates/moesp_kf", "/metrics/age", "/paths/truth"):
        assert {name, f"{name}/right"} <= topics


def test_a_fast_stream_is_thinned_where_it_is_drawn_and_nowhere_else(tmp_path: Path) -> None:
    scenario = a_scenario(rate_hz=1000, patient={"tick_phase_ms": 0.5})
    payload = encode(a_pose())
    records = [Record(COMMAND, k * MS, payload, type(a_pose()), k * MS, k) for k in range(1000)]
    logs = _write(tmp_path / "r", {"surgeon": records})
    merge_logs(logs, tmp_path / "run.mcap", RunTopics.of(scenario, {}), {})
    found = _read(tmp_path / "run.mcap")
    assert len(found[f"/surgeon/{COMMAND}"]) == 1000
    assert [at // MS for at, _, _ in found["/mtm"]] == list(range(0, 1000, 10))
    assert len(found["/tf"]) == 10


def test_rejected_messages_are_log_lines_the_first_ones(tmp_path: Path) -> None:
    note = Rejected(key=COMMAND, recv_ns=5, reason="no channel has this key", head_hex="00")
    found = _merge(tmp_path / "r", {"patient": [Record(REJECTED, k, note) for k in range(50)]})
    lines = [message for _, _, message in found["/log"]]
    assert len(lines) == 20
    assert lines[0].message == f"rejected on {COMMAND}: no channel has this key"
    assert lines[0].name == "patient"
    assert lines[0].level == 3
    assert "not listed" in lines[-1].message
    assert len(found["/patient/tis/rejected"]) == 50


def test_the_parts_of_a_log_are_merged_under_its_topics(tmp_path: Path) -> None:
    """That the first part is cut is no damage; the attachments of both stand side by side."""
    ticks = [Record(TICKS, k * MS, TickNote(tick=k, due_ns=k * MS, begin_ns=k * MS)) for k in range(30)]
    (first,) = _write(tmp_path / "r", {"surgeon": ticks[:15]})["surgeon"]
    first.write_bytes(first.read_bytes()[:-1200])
    second = first.with_name("surgeon_2.mcap")
    with McapLog(second, {"side": "surgeon"}) as log:
        log.attach("clock.json", b"{}")
        for tick in ticks[20:]:
            log.record(tick)
    merged = merge_logs({"surgeon": [first, second]}, tmp_path / "run.mcap", RunTopics.of(a_scenario(), {}), {})
    found = [message["tick"] for _, _, message in _read(tmp_path / "run.mcap")[f"/surgeon{TICKS}"]]
    n_first = len(found) - 10
    assert found == [*range(n_first), *range(20, 30)]
    assert 0 < n_first < 15
    assert (merged.n_messages, merged.problems) == ({"surgeon": n_first + 10}, [])
    with (tmp_path / "run.mcap").open("rb") as file:
        assert [one.name for one in make_reader(file).iter_attachments()] == ["surgeon_2/clock.json"]


def test_a_damaged_log_gives_its_beginning_and_is_named(tmp_path: Path, run_dir: Path, scenario: Scenario) -> None:
    for side in SIDES:
        shutil.copy(run_dir / f"{side}.mcap", tmp_path)
    log = tmp_path / "patient.mcap"
    cut(log)
    logs: dict[Side, list[Path]] = {side: [tmp_path / f"{side}.mcap"] for side in SIDES}
    merged = merge_logs(logs, tmp_path / "run.mcap", RunTopics.of(scenario, {}), {})
    assert len(merged.problems) == 1
    assert "patient.mcap is damaged" in merged.problems[0]
    counts = Counter(topic for topic, _ in LogReader(tmp_path / "run.mcap").messages())
    n_patient = sum(n for topic, n in counts.items() if topic.startswith("/patient/"))
    assert n_patient == merged.n_messages["patient"] > 0
    assert n_patient == sum(1 for _ in LogReader(log).messages())
    assert sorted(p.name for p in tmp_path.iterdir()) == ["netem.mcap", "patient.mcap", "run.mcap", "surgeon.mcap"]
