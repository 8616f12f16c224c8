"""Every decoder of bytes from outside, with the errors that it documents and valid samples to mutate."""

import json
import tempfile
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import dpkt
import numpy as np
from mcap.exceptions import McapError
from mcap.records import Chunk

from tests.common.runtime.recordings.tables import movement, write_csv, write_parquet
from tests.common.sources.trials import rows_of, text_of
from tests.common.test_device import BY_HAND as POSE_STAMPED
from tests.deploy.logs.hostile_files import channel, chunk, message, packed
from tests.deploy.net.test_foreign_records import frame
from tests.deploy.recordings_import.foreign_files import STORE, json_mcap, ros_mcap, ros_messages
from tests.fuzz.host_decoders import HOST_DECODERS
from tests.fuzz.scratch_folder import scratch_folder
from tests.fuzz.trust_decoders import TRUST_DECODERS
from tests.netem.bridge.test_handshake import OFFER
from tests.netem.control.test_control import a_control
from tests.patient_side.identification.test_model_file import model
from tests.patient_side.learned.models import learned_model
from tis.common.audit import verify as verify_audit
from tis.common.channels import hand_channels
from tis.common.clocks import Exchanges, fit_clock
from tis.common.device import DeviceGate, from_json, from_ros2
from tis.common.errors import TisError
from tis.common.host_records import CLOCK, PROCESSORS, ClockNote, ProcessorNote
from tis.common.intake import Intake
from tis.common.messages import FeedbackPose, Header, Quaternion, Sampled, SampledPose, Vector3, encode
from tis.common.node import Arrival, Emission, Record
from tis.common.records import (
    CONTROL,
    COUNTERS,
    ESTIMATES,
    FATES,
    TICKS,
    ControlNote,
    CounterNote,
    EstimateNote,
    FateBatch,
    TickNote,
)
from tis.common.refusal import refusal_in, sender_in, trouble_in
from tis.common.runtime.clock_watch import _read as read_reading
from tis.common.runtime.control import ControlKeys, Epoch, Roster
from tis.common.runtime.credentials import credentials
from tis.common.runtime.mcap_log import McapLog
from tis.common.runtime.recordings.table import table_recording
from tis.common.runtime.user_code import Origin, dump_origins, parse_origins
from tis.common.safety_records import StopsInForceNote
from tis.common.scenario.live_source import LiveSource
from tis.common.scenario.reading import build_scenario, parse_yaml
from tis.common.scenario.security import Password
from tis.common.scenario.sight import SightPart
from tis.common.scenario.table_source import TableSource
from tis.common.sight.fragments import cut
from tis.common.sight_records import ScreenNote
from tis.common.sources.jigsaws import COLUMNS, parse_trial
from tis.common.sources.jigsaws import pose_track as trial_track
from tis.common.sources.provenance import parse_played
from tis.common.sources.table_clock import played, row_clock
from tis.common.sources.table_columns import layout_of
from tis.common.sources.table_poses import finite_faults, pose_track
from tis.common.sources.table_text import read_columns, split_table
from tis.common.stop_messages import EmergencyStop, lock_of
from tis.common.trace import parse_trace
from tis.deploy.compare.grid import grid_faults
from tis.deploy.compare.study import Study
from tis.deploy.logs.blocks import RecordContent, SpentError, parse_records, unpack_chunk
from tis.deploy.logs.describe import describe
from tis.deploy.logs.log_paths import recovery_of
from tis.deploy.logs.read.load import load_side
from tis.deploy.logs.recover import recover
from tis.deploy.net.foreign_records import parse_capture, parse_round_trips
from tis.deploy.net.profiles import SHIPPED, build_profile
from tis.deploy.net.reflector import Batch
from tis.deploy.recordings_import.files import read_mcap
from tis.deploy.recordings_import.found import Wanted as Foreign
from tis.deploy.recordings_import.messages import decoder, in_ros
from tis.deploy.recordings_import.one_clock import on_one_clock
from tis.deploy.recordings_import.trajectories import form_of, read_trajectory
from tis.deploy.shell.run_dir import read_json
from tis.deploy.tools.certificates import certificates, new_authority
from tis.deploy.tools.runs import Wanted, list_runs
from tis.netem.bridge.handshake import Opening
from tis.netem.control.control import Control
from tis.patient_side.external_camera import ExternalCamera
from tis.patient_side.identification.model_file import dump_models, parse_models
from tis.patient_side.safety.emergency_stop import EmergencyStops
from tis.surgeon_side.live import DeviceMapping
from tis.surgeon_side.screen import ScreenNode

_ROW = hand_channels("left", "PSM2")
_FOLDER = scratch_folder()


class Decoder(NamedTuple):
    """A decoder, the errors that it may raise, and valid samples."""

    decode: Callable[[bytes], object]
    samples: Sequence[bytes]
    errors: tuple[type[Exception], ...] = (TisError,)


def _pose(**more: Any) -> dict[str, Any]:
    return {
        "sample_ns": 5,
        "position_m": Vector3(x=0.1, y=0.2, z=0.3),
        "orientation": Quaternion(x=0.0, y=0.0, z=0.0, w=1.0),
        "gripper_rad": 0.1,
        **more,
    }


def _taken(payload: bytes) -> None:
    for one in (_ROW.command, _ROW.estimated, _ROW.force, _ROW.motion):
        intake: Intake[Sampled] = Intake("tis", [one])
        intake.take(Arrival("east", one.key("tis"), payload, Header(1, 5).pack(), 10))


def _stopped(payload: bytes) -> None:
    stops = EmergencyStops("tis")
    for at_ns, key in enumerate(stops.keys):
        stops.take(Arrival("east", key, payload, b"", at_ns))
    EmergencyStops("tis").resume(payload, None)


def _attached(attachment: bytes) -> None:
    Header.unpack(attachment)
    Intake("tis", [_ROW.command]).take(Arrival("east", _ROW.command.key("tis"), _SAMPLED, attachment, 10))


def _controlled(payload: bytes) -> None:
    control: Control = a_control(forward={"delay": {"kind": "constant", "delay_ms": 3}})
    for operation in ("set", "outage", "profile", "reset"):
        answer, _ = control.handle(operation, payload, 5)
        assert len(answer.model_dump_json()) < 100_000


def _cdr_pose() -> bytes:
    [_, kind, _, message], *_ = ros_messages(movement(1))
    return bytes(STORE.serialize_cdr(message, kind))


def _sample(payload: bytes, key: str = "") -> Any:
    return SimpleNamespace(payload=SimpleNamespace(to_bytes=lambda: payload), key_expr=key)


def _reading(payload: bytes) -> None:
    answer = read_reading(1, 9, SimpleNamespace(ok=_sample(payload)))
    if answer is not None:
        fit_clock(Exchanges.of([answer.stamps]))


def _begin_and_end(payload: bytes) -> None:
    roster = Roster(ControlKeys("tis"), lambda: None)
    Epoch.parse(payload.decode(errors="replace"))
    roster._take_end(_sample(payload, roster.keys.end))


def _batch(data: bytes) -> None:
    payload, _, attachment = data.partition(b"|")
    Batch.unpack(payload, attachment)


def _scenario(data: bytes) -> None:
    build_scenario(parse_yaml(data.decode(errors="replace"), "a.yaml"), "a.yaml")


def _profile(data: bytes) -> None:
    build_profile(parse_yaml(data.decode(errors="replace"), "a.yaml"), "a.yaml")


def _study(data: bytes) -> None:
    raw = parse_yaml(data.decode(errors="replace"), "a.yaml")
    study = Study.model_validate(raw, context={"where": "a.yaml"})
    grid_faults(study.request.sweeps, study.request.zipped)


def _device(data: bytes) -> None:
    """Follow a device that sends this twice, in either encoding."""
    for decode in (from_json, from_ros2):
        gate, mapping = DeviceGate(decode, 10**9), DeviceMapping(LiveSource(kind="live"), "left")
        for _ in range(2):
            gate.take(1, data)
        samples = gate.drain()
        if samples:
            mapping.move(samples, 2, 1)
        mapping.poses()


def _camera(data: bytes) -> None:
    camera = ExternalCamera("tis", SightPart(camera="external"), 10**9)
    for output in camera.receive(Arrival("east", "tis/ECM/camera", data, b"", 10**8)):
        assert isinstance(output, Emission)
        output.on_sent(10**8)


def _trial(data: bytes) -> None:
    rows = parse_trial(data.decode(errors="replace"), "a.txt")
    for device in COLUMNS:
        trial_track(rows, device, "a.txt")


def _trajectory(data: bytes) -> None:
    text = data.decode(errors="replace")
    form = form_of(text)
    if form is not None:
        read_trajectory(Path("a.txt"), text, form, Foreign())


def _table(data: bytes) -> None:
    text = split_table(data.decode(errors="replace"), "a.csv")
    layout = layout_of(TableSource(kind="table", path="a.csv"), text.names, "a.csv")
    columns = read_columns(text, layout.names, "a.csv", layout.time)
    if finite_faults(columns, "a.csv"):
        return
    clock, _ = row_clock(columns["time_s"], "a.csv", "time_s")
    if clock is not None:
        played(clock, 30, True, "bridge", "a.csv")
    for device in (layout.hands[0].master, layout.hands[0].follower):
        if device is not None:
            pose_track(columns, device, "a.csv")


def _table_file(data: bytes) -> None:
    path = _FOLDER / "a.parquet"
    path.write_bytes(data)
    table_recording(TableSource(kind="table", path=str(path)), path, 30, 10, 0)


def _imported(data: bytes) -> None:
    path = _FOLDER / "d.mcap"
    path.write_bytes(data)
    on_one_clock(read_mcap(path, Foreign()), None, "d.mcap")


def _cdr(data: bytes) -> None:
    for kind in ("geometry_msgs/msg/PoseStamped", "sensor_msgs/msg/JointState"):
        with suppress(ValueError, LookupError):
            in_ros(decoder(kind)(data), 5, is_pose="Pose" in kind)


def _chunk(data: bytes) -> None:
    unpack_chunk(Chunk.read(RecordContent(data)))


def _log(data: bytes) -> None:
    path = _FOLDER / "a.mcap"
    path.write_bytes(data)
    (_FOLDER / "b.mcap").unlink(missing_ok=True)
    recovery_of(path)
    for read in (describe, lambda p: recover(p, _FOLDER / "b.mcap"), lambda p: load_side(p, "netem")):
        with suppress(TisError):
            read(path)


def _records(data: bytes) -> None:
    """Decode as records of each kind; the first byte chooses the topic."""
    topics = (TICKS, FATES, CONTROL, COUNTERS, CLOCK, PROCESSORS, f"{ESTIMATES}/hold", "/a", "tis/PSM2/setpoint_cp")
    topic = topics[data[0] % len(topics)] if data else "/a"
    path = _FOLDER / "c.mcap"
    records = channel(1, topic) + message(data[1:])
    path.write_bytes(_HEAD + chunk(records, len(records), ""))
    load_side(path, "netem")


def _json_files(data: bytes) -> None:
    (_FOLDER / "scenario.yaml").touch()
    (_FOLDER / "summary.json").write_bytes(data)
    (_FOLDER / "manifest.json").write_bytes(data)
    from rich.console import Console

    quiet = Console(quiet=True)
    list_runs(Wanted(_FOLDER, "written", False, None, None, None), quiet, quiet, False)
    read_json(_FOLDER / "summary.json")


def _whole_log() -> bytes:
    path = _FOLDER / "whole.mcap"
    path.unlink(missing_ok=True)
    with McapLog(path, {"side": "netem"}) as log:
        log.attach("scenario.yaml", b"x")
        for k in range(6):
            log.record(Record(TICKS, 10 * k, TickNote(tick=k, due_ns=10 * k, begin_ns=10 * k + 1)))
            log.record(Record("tis/MTML/measured_cp", 10 * k, _SAMPLED))
            log.flush()
    return path.read_bytes()


_DEVICE = (
    b'{"stamp_ns": 5, "position_m": {"x": 0.1, "y": 0, "z": -1}, "gripper_rad": 0.3, "clutch": true, '
    b'"target_run": {"delay_ms": 300, "with_ghost": true, "time_s": 12.5, "path_mm": 402.5, "n_misses": 1}}'
)
_SAMPLED = encode(SampledPose(**_pose()))
_TWO_POSES = [(k, json.loads(_SAMPLED) | {"sample_ns": k}) for k in (1, 2)]
_FEEDBACK = encode(FeedbackPose(**_pose(tick=3, command_sample_ns=4)))
_WHOLE = _whole_log()
_HEAD = _WHOLE[: _WHOLE.index(b"\x09", 8)]
_FATES = FateBatch(
    direction="forward",
    key="a",
    foreign=False,
    seq=(1,),
    offered_ns=(1,),
    outcome=("deliver",),
    delay_ns=(1,),
    release_ns=(2,),
    n_bytes=(3,),
    copies=(0,),
    flipped=(0,),
)
_NOTES = (
    (0, TickNote(tick=1, due_ns=2, begin_ns=3)),
    (1, _FATES),
    (2, ControlNote(at_ns=1, applied_ns=2, request="{}", added="[]", accepted=True)),
    (3, CounterNote(name="a", value=1)),
    (4, ClockNote(boot_id="a", reference_boot_id="b", shared=False, epoch_ns=1, reference_epoch_ns=2)),
    (5, ProcessorNote(from_ns=0, to_ns=9, processors="0-3,6", own_ns=4)),
    (6, EstimateNote(tick=1, t_ns=1, hand="left", estimator="hold", position_m=Vector3(x=0.0, y=0.0, z=0.0))),
)
_STOP = encode(EmergencyStop(stop=True, reason="smoke", number=7, lock=lock_of("a")))
_RELEASE = encode(EmergencyStop(stop=False, number=8, ends=7, secret="a"))
_IN_FORCE = encode(StopsInForceNote(at_ns=5, stops=f"7:{lock_of('a')} 8:", others=1))
_REQUEST = b'{"direction":"both","change":{"loss_pct":3},"for_s":2}'
_PLAYED = {"label": "a", "digest": "b", "first_row": 0, "n_rows": 3, "rate_hz": 30, "file": None, "warnings": ["x"]}
_SCENARIO = (SHIPPED.parent / "scenarios" / "lossy.yaml").read_bytes()
_PROFILES = [(SHIPPED / f"{name}.yaml").read_bytes() for name in ("wifi_bad", "geo_satellite")]
_TRACE = b"# host: west\n# rate_hz: 1000\nsent_s,delay_ms\n0,12.25\n0.001,\n0.002,12.5\n"
_ORIGINS = dump_origins({"a:B": Origin("a.py", "00", {"c.py": "11"})})
_MODEL = dump_models([model(1)])
_MODELS = [_MODEL, dump_models([replace(model(1), learned=(learned_model("cnn"),))])]
_STUDY = (
    b"scenario: default\nsettings: {a.b: {c: 1}}\naxes:\n  a.c: {first: 0, last: 9.5, count: 4, spacing: linear}\n"
    b"  d: [1, 2.5, true, wifi]\nzip: true\nseeds: 3\nduration_s: 5\nestimators: [hold]\npeople: [D]\n"
)
_SUMMARY = json.dumps({"scenario": "a", "valid": True, "latency_ms": {"end_to_end": {"p50": 3}}}).encode()
_READING = b'{"boot_id":"a","received_ns":3,"replied_ns":4}'


def _log_line(data: bytes) -> None:
    refusal_in(data)
    sender_in(data)
    verify_audit(data.splitlines(keepends=True))
    trouble_in(data)


_AT = b"2026-11-23T00:26:47.160013Z  WARN acc-0 ThreadId(05) "
_LOG_LINES = [
    _AT + b"zenoh_link_tls::unicast: invalid peer certificate: BadSignature",
    _AT + b"zenoh::net::runtime::orchestrator: Unable to connect to configured peer tls/a:1! received fatal alert: A",
]


def _passwords(data: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "passwords.txt")
        file.touch(mode=0o600)
        file.write_bytes(data)
        credentials(Password(kind="password", file=str(file)), "netem")


def _a_certificate() -> bytes:
    with tempfile.TemporaryDirectory() as folder:
        new_authority(Path(folder))
        return Path(folder, "ca", "ca.pem").read_bytes()


def _certificates(data: bytes) -> None:
    """Decode as the authority's certificate, and as a name's."""
    with tempfile.TemporaryDirectory() as folder:
        new_authority(Path(folder))
        place = Path(folder, "surgeon")
        place.mkdir(mode=0o700)
        for name in ("ca.pem", "cert.pem", "key.pem"):
            (place / name).touch(mode=0o600)
            (place / name).write_bytes(data)
        certificates(Path(folder))
        Path(folder, "ca", "ca.pem").write_bytes(data)
        certificates(Path(folder))


_ROUND_TRIPS = [
    b"[1.5] 64 bytes from 192.0.2.1: icmp_seq=1 ttl=54 time=20.0 ms",
    b'{"round_trips":[{"seqno":0,"lost":"false","timestamps":{"client":{"send":{"wall":5}}},"delay":{"rtt":7}}]}',
    b"seq,sent_s,rtt_ms\n1,0,5\n2,1,\n",
]


def _capture() -> bytes:
    file = BytesIO()
    writer = dpkt.pcap.Writer(file)
    writer.writepkt(frame(b"a message"), 5.0)
    return file.getvalue()


DECODERS: dict[str, Decoder] = {
    "packet header": Decoder(_attached, [Header(7, 9).pack()]),
    "pose and feedback": Decoder(_taken, [_SAMPLED, _FEEDBACK]),
    "device, JSON and ROS 2": Decoder(_device, [_DEVICE, POSE_STAMPED]),
    "camera": Decoder(_camera, [b'{"timestamp":{"sec":1,"nsec":2},"format":"jpeg","data":"/9j/4AAQ"}']),
    "opening of a connection": Decoder(lambda data: Opening().take(data), [OFFER]),
    "emergency stop": Decoder(_stopped, [_STOP, _RELEASE, _IN_FORCE]),
    "control request": Decoder(_controlled, [_REQUEST, b"[" + _REQUEST + b"]", b'{"for_s":3}']),
    "clock reading": Decoder(_reading, [_READING]),
    "begin and end": Decoder(_begin_and_end, [b'{"epoch_ns":5,"run_id":7}', b'{"reason":"over"}']),
    "Zenoh's log": Decoder(_log_line, _LOG_LINES),
    "passwords": Decoder(_passwords, [b"surgeon:secret\nnetem:other\n"]),
    "certificates": Decoder(_certificates, [_a_certificate()]),
    "probe batch": Decoder(_batch, [bytes(24) + b'|{"name":"a","first":0,"total":1}']),
    "scenario": Decoder(_scenario, [_SCENARIO]),
    "profile": Decoder(_profile, _PROFILES),
    "study": Decoder(_study, [_STUDY]),
    "trace": Decoder(lambda data: parse_trace(data.decode(errors="replace"), "a.csv"), [_TRACE]),
    "round trips": Decoder(lambda data: parse_round_trips(data.decode(errors="replace"), "a"), _ROUND_TRIPS),
    "capture": Decoder(lambda data: parse_capture(data, "a"), [_capture()]),
    "model": Decoder(
        lambda data: parse_models(data, "a"),
        _MODELS,
    ),
    "JIGSAWS text": Decoder(_trial, [text_of(rows_of(3)).encode()]),
    "trajectory": Decoder(
        _trajectory,
        [
            b"# timestamp tx ty tz qx qy qz qw\n1.5 0 0 0 0 0 0 1\n1.6 0 0 0 0 0 0 1\n",
            b"#timestamp [ns], p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m]\n15,0,0,0\n16,0,0,0\n",
        ],
    ),
    "table text": Decoder(_table, [write_csv(_FOLDER / "a.csv", movement(4)).read_bytes()]),
    "Parquet table": Decoder(_table_file, [write_parquet(_FOLDER / "b.parquet", movement(4)).read_bytes()]),
    "foreign MCAP": Decoder(
        _imported,
        [
            ros_mcap(_FOLDER / "e.mcap", movement(4)).read_bytes(),
            json_mcap(_FOLDER / "f.mcap", {"/MTML/measured_cp": _TWO_POSES}).read_bytes(),
        ],
    ),
    "CDR": Decoder(_cdr, [_cdr_pose()]),
    "chunk": Decoder(_chunk, [packed(message(b"abc"))[9:]], (ValueError, McapError)),
    "records of a chunk": Decoder(parse_records, [channel(1, "/a") + message(b"abc")], (ValueError, SpentError)),
    "records": Decoder(_records, [bytes([k]) + encode(note) for k, note in _NOTES]),
    "MCAP file": Decoder(_log, [_WHOLE]),
    "summary and manifest": Decoder(_json_files, [_SUMMARY]),
    **{name: Decoder(*arguments) for name, arguments in (HOST_DECODERS | TRUST_DECODERS).items()},
    "origins": Decoder(lambda data: parse_origins(data, "a"), [_ORIGINS]),
    "played rows": Decoder(lambda data: parse_played(data, "a"), [json.dumps(_PLAYED).encode()]),
}


class _ForgivingCodec:
    """Makes a picture of whatever there is, so that a screen's own work is what is fuzzed."""

    is_sound = True

    def decode(self, stretches: Sequence[tuple[int, bytes]], n_bytes: int) -> Any:
        assert sum(len(content) for _, content in stretches) <= n_bytes
        return np.zeros((240, 320, 3), dtype=np.uint8) if stretches else None


_SIGHT = SightPart(width=320, height=240, fragment_bytes=20)
_FRAGMENTS = [payload for frame in range(2) for payload, _ in cut(frame, _SIGHT.captured_ns(frame), bytes(50), 20)]


def _screened(data: bytes) -> None:
    """Show the messages of a screen, each with its length before it; nothing is shown as complete that is not."""
    screen = ScreenNode("tis", _SIGHT, _ForgivingCodec())
    records: list[Any] = []
    at, now_ns = 0, 100_000_000
    while at < len(data):
        n_bytes = data[at]
        payload, at, now_ns = data[at + 1 : at + 1 + n_bytes], at + 1 + n_bytes, now_ns + 1_000_000
        records += screen.receive(Arrival("west", "tis/ECM/video", payload, Header(3, now_ns).pack(), now_ns))
        due_ns = screen.next_wake_ns()
        if due_ns is not None and due_ns <= now_ns:
            records += screen.wake(now_ns)
    records += screen.finish(now_ns)
    notes = [one.data for one in records if isinstance(one.data, ScreenNote)]
    assert [note.frame for note in notes] == list(range(len(notes)))
    assert all(not note.missing for note in notes if note.state == "complete")


DECODERS["frames of a screen"] = Decoder(
    _screened, [b"".join(bytes([len(one)]) + one for one in _FRAGMENTS[i:] + _FRAGMENTS[:i]) for i in range(3)]
)


def decode(name: str, data: bytes) -> None:
    """Decode; raises any exception that the decoder does not document, and `AssertionError` for endless output."""
    decoder, refused = DECODERS[name], ""
    try:
        with np.errstate(all="ignore"):
            decoder.decode(data)
    except decoder.errors as error:
        refused = str(error)
    assert len(refused) < 1000 + 200 * len(data), "the error is longer than its cause"
