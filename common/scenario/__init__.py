"""A scenario, the complete description of a run: frozen, no unknown keys, human units, delays one way."""

import difflib
from collections.abc import Mapping
from typing import Annotated, Final, Literal, Self

from pydantic import Discriminator, Field, StringConstraints, Tag, WithJsonSchema, model_validator

from tis.common.errors import Fault, InputError
from tis.common.scenario.base import NonNegative, Part, Positive, RuleText, obeys, refuse
from tis.common.scenario.estimator_names import AnyEstimatorName
from tis.common.scenario.identification import Estimators, Identification
from tis.common.scenario.limits import Limits
from tis.common.scenario.network import NetworkPart, Rule
from tis.common.scenario.network.pipeline import Pipeline
from tis.common.scenario.patient import PatientPart
from tis.common.scenario.security import NoSecurity, Security
from tis.common.scenario.sight import SightPart
from tis.common.scenario.source import Source
from tis.common.scenario.surgeon import MAX_MB_PER_S, MAX_PACKETS_PER_S, SurgeonPart
from tis.common.scenario.touch import TouchPart, touch_rules
from tis.common.units import s_to_ns
from tis.common.zenoh_syntax import endpoint_fault, is_local, is_tls

_MAX_SAMPLES = 5_000_000  # a synthetic movement is held in memory

AUTO: Final = "auto"
"""Duration of a run that plays all of its recording: `tis.common.runtime.recordings.whole_run` resolves it."""

_LONGEST_S: Final = 86_400
Duration = Annotated[
    Positive,
    Field(le=_LONGEST_S),
    WithJsonSchema(
        {
            "anyOf": [
                {"exclusiveMinimum": 0, "maximum": _LONGEST_S, "type": "number"},
                {"const": AUTO, "type": "string"},
            ]
        }
    ),
]

KeyChunk = Annotated[
    str,
    StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$"),
    RuleText("must consist of letters, digits, '_', '.' and '-', and not begin with '.' or '-'"),
]


Endpoint = Annotated[str, obeys(endpoint_fault)]


class Hosts(Part):
    """Endpoints on which netem listens; the surgeon connects to west, the patient to east."""

    west: Endpoint = Field(description="Zenoh endpoint of the surgeon's network, like tcp/192.168.1.5:7447.")
    east: Endpoint = Field(description="Zenoh endpoint of the patient's network, like tcp/192.168.1.5:7448.")

    @property
    def endpoints(self) -> tuple[str, str]:
        """Both endpoints, west and east."""
        return self.west, self.east


def _auto_or_hosts(value: object) -> str | None:
    if isinstance(value, Mapping | Hosts):
        return "Hosts"
    return "auto" if value == "auto" else None


HostsOrAuto = Annotated[
    Annotated[Hosts, Tag("Hosts")] | Annotated[Literal["auto"], Tag("auto")],
    Discriminator(
        _auto_or_hosts,
        custom_error_type="in_words",
        custom_error_message="must be 'auto' or {west: ENDPOINT, east: ENDPOINT}",
    ),
]


class Scenario(Part):
    """Complete description of a run, except for the timing of the machines."""

    version: Literal[1] = Field(description="Version of the scenario format.")
    name: KeyChunk = Field(description="Name of the scenario, used in reports and run folders.")
    session: KeyChunk = Field("tis", description="First chunk of every Zenoh key of the run.")
    seed: int = Field(1, ge=0, strict=True, description="Seed of every random number of the run.")
    duration_s: Duration = Field(
        20.0,
        description="Time during which the surgeon sends samples, in s; auto: all of the recording, from its first "
        "row on.",
    )
    drain_s: NonNegative = Field(
        1.0, le=60, description="Time after duration_s in which messages in flight may still arrive, in s."
    )
    source: Source = Field(description="Source of the surgeon's movement.")
    rate_hz: int = Field(
        30, strict=True, ge=1, le=10_000, description="Samples of the surgeon and ticks of the patient per second."
    )
    topology: Literal["teleoperation", "observer"] = Field(
        "teleoperation",
        description="Streams that the network impairs. teleoperation: the commands and the arm's poses; observer "
        "(the paper's set-up): the arm's poses only, the commands pass unimpaired.",
    )
    surgeon: SurgeonPart = Field(SurgeonPart(), description="How the surgeon's side sends its samples.")
    patient: PatientPart = Field(PatientPart(), description="The patient's ticks and the plant that moves there.")
    network: NetworkPart = Field(NetworkPart(), description="The emulated network.")
    touch: TouchPart | None = Field(
        None, description="What the arms touch, and how the hands feel it. Not given: nothing is touched."
    )
    sight: SightPart | None = Field(
        None, description="A camera on the patient's side and the surgeon's screen. Not given: there is no picture."
    )
    identification: Identification = Field(
        Identification(), description="How the arm's model is identified before the run."
    )
    estimators: Estimators = Field(
        ("hold", "innovations_kf"),
        description="Estimators that run side by side on the same arrivals: names of built-in ones, or "
        "module:factory for a user-defined one, whose code is executed.",
    )
    active_estimator: AnyEstimatorName = Field(
        "innovations_kf", description="The estimator whose output the patient's side publishes and acts on."
    )
    limits: Limits = Field(Limits(), description="Limits that the summary's verdicts compare the run with.")
    hosts: HostsOrAuto = Field(
        "auto",
        description="Endpoints on which netem listens; auto: free loopback ports that `tis run` chooses (single "
        "host only).",
    )
    security: Security = Field(
        NoSecurity(kind="none"), description="Encryption and authentication of the links, and who may say what."
    )
    on_peer_loss: Literal["end", "continue"] | None = Field(
        None,
        description="Whether a run ends when another side's process dies. Not given: end in `tis run`, continue "
        "when a side is started alone.",
    )

    on_log_loss: Literal["end", "continue"] = Field(
        "continue",
        description="Whether a run ends when a log cannot be written any more: the disk is full, the folder deleted. "
        "It is told at once in either case.",
    )
    on_rejoin: Literal["count", "exclude"] = Field(
        "count",
        description="Whether the time without a side that was started anew in mid-run counts in the figures: as "
        "missed ticks, lost packets and error, or not at all. The report shows it in either case.",
    )
    peer_timeout_s: Positive = Field(
        10.0,
        ge=2,
        le=3600,
        description="Silence after which another side counts as lost, in s, although its process may live: it stands "
        "still, or the network between the hosts carries nothing.",
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        n_packets = self.surgeon.packets_per_s(self.rate_hz, len(self.source.hands))
        mb = self.surgeon.mb_per_s(self.rate_hz, len(self.source.hands))
        near = difflib.get_close_matches(self.active_estimator, self.estimators, n=1)
        meant = f", did you mean {near[0]!r}?" if near else ""
        active = f"active_estimator {self.active_estimator}"
        rules = {
            f"{active} must be one of estimators ({', '.join(self.estimators)}){meant}": (
                self.active_estimator in self.estimators
            ),
            **self.source.rules(self.session, self.rate_hz, self.identification.train, self.patient.plant.kind),
            **touch_rules(self.touch, self.patient, self.surgeon, self.rate_hz),
            "patient.safety.enabled must be true with an external plant, which follows the set points": (
                self.patient.plant.kind != "external" or self.patient.safety.enabled
            ),
            "duration_s must contain at least one sample at rate_hz": self.n_samples >= 1,
            f"duration_s must contain at most {_MAX_SAMPLES} samples at rate_hz": self.n_samples <= _MAX_SAMPLES,
            f"patient.tick_phase_ms must be less than one period of rate_hz, as {500 / self.rate_hz:g} is": (
                self.patient.tick_phase_ms * self.rate_hz < 1000
            ),
            "hosts must be endpoints like tls/192.168.1.5:7447 with security mtls": (
                self.security.kind != "mtls" or self.hosts == "auto" or all(map(is_tls, self.hosts.endpoints))
            ),
            "patient.gate.on_conflict must be warn where the network corrupts messages, whose copies then differ": (
                self.patient.gate.on_conflict != "hold" or not self.network.corrupts("forward")
            ),
            "patient.safety.release must not be named without security mtls or password, which prove names": (
                self.patient.safety.release != "named" or self.security.kind != "none"
            ),
            f"surgeon.copies must give at most {MAX_PACKETS_PER_S} packets a second at this rate_hz and number of "
            f"hands ({n_packets})": n_packets <= MAX_PACKETS_PER_S,
            f"surgeon.copies and surgeon.history must give at most {MAX_MB_PER_S} MB a second at this rate_hz and "
            f"number of hands (about {mb:.0f})": mb <= MAX_MB_PER_S,
        }
        refuse(rule for rule, holds in rules.items() if not holds)
        return self

    @property
    def n_samples(self) -> int:
        """Number of samples that the surgeon sends, and of the patient's ticks."""
        return int(self.duration_s * self.rate_hz + 1e-9)  # 0.3 s at 10 Hz is 2.9999999999999996 in floats

    def first_row(self) -> int:
        """Return the row that becomes sample 0; raises `InputError` when training rows would be scored."""
        identification, start = self.identification, self.source.start
        first = identification.train_samples if identification.train == "own_head" else 0
        if start == "auto":
            return first
        if start < first:
            rule = f"must be auto or at least train_samples = {first}, since own_head trains on the rows before"
            raise InputError(Fault(f"scenario {self.name}", "source.start", rule, start))
        return start

    @property
    def end_ns(self) -> int:
        """Run time at which every side stops, after the drain."""
        return s_to_ns(self.duration_s + self.drain_s)

    @property
    def on_conflict(self) -> Literal["hold", "warn"]:
        """What the patient does when samples contradict each other: as the scenario says, or by hosts and network."""
        if self.patient.gate.on_conflict is not None:
            return self.patient.gate.on_conflict
        is_one_machine = self.hosts == "auto" or all(map(is_local, self.hosts.endpoints))
        return "warn" if is_one_machine or self.network.corrupts("forward") else "hold"

    @property
    def simulates_hand(self) -> bool:
        """Whether `touch.operator` feels the forces: the source then tells what it intends."""
        return self.touch is not None and (self.source.kind != "live" or self.touch.live_hand == "simulated")

    @property
    def impaired_keys(self) -> tuple[str, ...]:
        """Key expressions of the run's messages and of the caches of advanced publishers; both are impaired."""
        return (f"{self.session}/**", f"{self.session}/**/@adv/**")

    def generated_rules(self) -> tuple[Rule, ...]:
        """Return the rules that the topology adds to the network's own."""
        if self.topology == "teleoperation":
            return ()
        return tuple(
            Rule(key=f"{self.session}/{master}/measured_cp", direction="forward", pipeline=Pipeline())
            for master in ("MTML", "MTMR")
        )

    def peer_loss_policy(self, side_alone: bool) -> Literal["end", "continue"]:
        """Return whether the run ends or continues when a peer dies."""
        return self.on_peer_loss or ("continue" if side_alone else "end")


def virtual_time_faults(where: str, scenario: Scenario) -> list[Fault]:
    """Return the faults of a scenario that cannot run in virtual time.

    Its movement, its arm or its picture is made elsewhere, or its network holds back senders, whose queues only live
    runs have.
    """
    source, patient, network, sight = scenario.source, scenario.patient, scenario.network, scenario.sight
    faults = []
    if source.kind == "live":
        rule = "must be recorded or synthetic in virtual time: nothing tells what a live device would do"
        faults.append(Fault(where, "source.kind", rule, source.kind))
    if patient.plant.kind == "external":
        rule = "must be replay, servo or mujoco in virtual time: an external arm moves in real time only"
        faults.append(Fault(where, "patient.plant.kind", rule, patient.plant.kind))
    if sight is not None and sight.is_external:
        rule = "must be drawn in virtual time: nothing tells what a camera of others would show"
        faults.append(Fault(where, "sight.camera", rule, sight.camera))
    if network.pushes_back:
        rule = "must be false in virtual time: no sender of Zenoh is there that could wait or drop"
        faults.append(Fault(where, "network.*.rate.backpressure", rule, True))
    return faults


def check_foreign_surgeon(where: str, source: Source) -> None:
    """Raise `InputError` where another program cannot be the surgeon: the source would tell another movement."""
    if source.kind != "live":
        rule = "must be live with a foreign surgeon: only then nothing is expected of its movement"
        raise InputError(Fault(where, "source.kind", rule, source.kind))
