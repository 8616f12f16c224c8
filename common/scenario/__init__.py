"""A scenario: everything that decides a run. Frozen, no unknown keys, human units, one way per direction."""

from collections.abc import Mapping
from typing import Annotated, Literal, Self

from pydantic import AfterValidator, Discriminator, Field, StringConstraints, Tag, model_validator

from common.channels import Side
from common.endpoint import endpoint_fault
from common.scenario.base import InWords, NonNegative, Part, Positive
from common.scenario.estimator_names import AnyEstimatorName
from common.scenario.limits import Limits
from common.scenario.network import NetworkPart, Rule
from common.scenario.network.pipeline import Pipeline
from common.scenario.patient import Estimators, Identification, PatientPart
from common.scenario.source import Source
from common.scenario.surgeon import MOST_MB_PER_S, MOST_PACKETS_PER_S, SurgeonPart
from common.units import s_to_ns

_MOST_SAMPLES = 5_000_000  # a synthetic movement is held in memory

KeyChunk = Annotated[
    str,
    StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]*$"),
    InWords("must be letters, digits, '_', '.' and '-', the first no '.' or '-'"),
]


def _endpoint(value: str) -> str:
    fault = endpoint_fault(value)
    if fault is not None:
        raise ValueError(fault)
    return value


Endpoint = Annotated[str, AfterValidator(_endpoint)]


class Hosts(Part):
    """Where netem listens; the surgeon connects to west, the patient to east."""

    west: Endpoint = Field(description="Zenoh endpoint of the surgeon's network, like tcp/192.168.1.5:7447.")
    east: Endpoint = Field(description="Zenoh endpoint of the patient's network, like tcp/192.168.1.5:7448.")


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


class NoSecurity(Part):
    """No encryption, no authentication: for loopback and laboratory networks."""

    kind: Literal["none"] = Field(description="none: the links are open.")


class Scenario(Part):
    """Everything that decides a run, but for the machines' own timing."""

    version: Literal[1] = Field(description="Version of this format.")
    name: KeyChunk = Field(description="Name of the scenario, as in reports and run folders.")
    session: KeyChunk = Field("tis", description="First chunk of every key.")
    seed: int = Field(1, ge=0, strict=True, description="Decides every random number of the run.")
    duration_s: Positive = Field(20.0, le=86_400, description="How long the surgeon moves, in s.")
    drain_s: NonNegative = Field(1.0, le=60, description="How long messages in flight may still arrive, in s.")
    source: Source = Field(description="Where the movement comes from.")
    rate_hz: int = Field(30, strict=True, ge=1, le=10_000, description="Samples and ticks a second.")
    topology: Literal["teleoperation", "observer"] = Field(
        "teleoperation",
        description="teleoperation: command and arm both cross the network; observer (the paper's): the "
        "commands pass clean, only the arm's measurements are impaired.",
    )
    surgeon: SurgeonPart = Field(SurgeonPart(), description="How the surgeon's side sends.")
    patient: PatientPart = Field(PatientPart(), description="How the patient's side ticks and what moves there.")
    network: NetworkPart = Field(NetworkPart(), description="The emulated network.")
    identification: Identification = Field(Identification(), description="How the arm's model is found.")
    estimators: Estimators = Field(
        ("hold", "innovations_kf"),
        description="Side by side on the same arrivals; module:factory is one of your own, whose code is run.",
    )
    active_estimator: AnyEstimatorName = Field("innovations_kf", description="The one that the patient acts on.")
    limits: Limits = Field(Limits(), description="What the run is held against.")
    hosts: HostsOrAuto = Field("auto", description="auto: free loopback ports, chosen by `tis run`.")
    security: Annotated[NoSecurity, Field(discriminator="kind")] = Field(
        NoSecurity(kind="none"), description="Protection of the links."
    )
    on_peer_loss: Literal["end", "continue"] | None = Field(
        None, description="When a peer dies; not given: end in `tis run`, continue for a single side."
    )

    @model_validator(mode="after")
    def _consistent(self) -> Self:
        source = self.source.kind
        n_packets = self.surgeon.packets_per_s(self.rate_hz, len(self.source.hands))
        mb = self.surgeon.mb_per_s(self.rate_hz, len(self.source.hands))
        rules = {
            f"active_estimator must be one of estimators ({', '.join(self.estimators)})": (
                self.active_estimator in self.estimators
            ),
            "rate_hz must be 30: a JIGSAWS trial plays at the rate it was recorded": (
                source != "jigsaws" or self.rate_hz == 30
            ),
            "identification.train must be own_head or a model file: a synthetic source has no others": (
                source != "synthetic" or self.identification.train != "others"
            ),
            "duration_s must hold at least one sample at rate_hz": self.n_samples >= 1,
            f"duration_s must hold at most {_MOST_SAMPLES} samples at rate_hz": self.n_samples <= _MOST_SAMPLES,
            "patient.tick_phase_ms must be less than one period of rate_hz": (
                self.patient.tick_phase_ms * self.rate_hz < 1000
            ),
            f"surgeon.copies must make at most {MOST_PACKETS_PER_S} packets a second, at this rate_hz and number of "
            f"hands ({n_packets})": n_packets <= MOST_PACKETS_PER_S,
            f"surgeon.copies and surgeon.history must make at most {MOST_MB_PER_S} MB a second, at this rate_hz and "
            f"number of hands (about {mb:.0f})": mb <= MOST_MB_PER_S,
        }
        broken = [rule for rule, holds in rules.items() if not holds]
        if broken:
            raise ValueError("\n".join(broken))
        return self

    @property
    def n_samples(self) -> int:
        """Samples that the surgeon sends, and ticks of the patient."""
        return int(self.duration_s * self.rate_hz + 1e-9)

    @property
    def end_ns(self) -> int:
        """Run time at which every side stops, after the drain."""
        return s_to_ns(self.duration_s + self.drain_s)

    @property
    def impaired_keys(self) -> tuple[str, ...]:
        """Key expressions that get the network's own pipelines: ours, and the caches of advanced publishers."""
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
        """Return what to do when a peer dies."""
        return self.on_peer_loss or ("continue" if side_alone else "end")


__all__ = ["Scenario", "Side"]
