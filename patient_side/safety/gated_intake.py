"""Reception at the patient: what the intake decodes and the gates admit; the rest is quarantined."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import get_args

from msgspec.structs import replace

from tis.common.intake import Accepted, Intake
from tis.common.messages import Pose, SampledPose, position_m
from tis.common.node import Arrival, Record
from tis.common.safety_records import QUARANTINE, QUARANTINED, QuarantineNote
from tis.patient_side.safety.evidence import Evidence
from tis.patient_side.safety.gate import Kind, StreamGate


@dataclass
class GatedIntake:
    """Intake with a gate for each key; a key without one admits all that is new.

    ``conflicts`` collects, by key, that samples contradict each other.
    """

    intake: Intake[Pose]
    gates: Mapping[str, StreamGate]
    conflicts: Mapping[str, Evidence] = field(default_factory=dict)
    n_quarantined: Counter[Kind] = field(default_factory=Counter)

    def take(self, arrival: Arrival) -> tuple[Accepted[Pose] | None, list[Record]]:
        """Return the message to use, or None, and the records to log.

        A second copy is not used, and no fault. What is quarantined is logged as that, and not as received. The
        number of a message that a gate refuses stays free for the true one.
        """
        accepted, records = self.intake.take(arrival)
        if accepted is None or (accepted.duplicate and not accepted.conflicting):
            return None, records
        admitted = self.admitted(accepted, arrival.key, arrival.recv_ns)
        if isinstance(admitted, Accepted):
            return admitted, records
        kind = admitted
        x_m, y_m, z_m = position_m(accepted.message)
        note = QuarantineNote(
            key=arrival.key,
            seq=accepted.header.seq,
            recv_ns=arrival.recv_ns,
            sample_ns=accepted.message.sample_ns,
            x_m=x_m,
            y_m=y_m,
            z_m=z_m,
            kind=kind,
        )
        return None, [Record(QUARANTINE, arrival.recv_ns, note)]

    def admitted(self, accepted: Accepted[Pose], key: str, recv_ns: int) -> Accepted[Pose] | Kind:
        """Return the new message as its gate admits it, or why it is refused, which is counted."""
        kind = self._refusal(accepted, key, recv_ns)
        if kind is None:
            return self._with_sound_history(accepted, key, recv_ns)
        self._count(kind, key, recv_ns)
        return kind

    def _count(self, kind: Kind, key: str, recv_ns: int) -> None:
        self.n_quarantined[kind] += 1
        if kind == "conflicting" and key in self.conflicts:
            self.conflicts[key].note(recv_ns)

    def _refusal(self, accepted: Accepted[Pose], key: str, recv_ns: int) -> Kind | None:
        if accepted.conflicting:
            return "conflicting"
        gate, seq = self.gates.get(key), accepted.header.seq
        kind = None if gate is None else gate.refusal(accepted.message, seq, recv_ns)
        if kind is not None:
            self.intake.forget(key, seq)
        return kind

    def _with_sound_history(self, accepted: Accepted[Pose], key: str, recv_ns: int) -> Accepted[Pose]:
        """Return a message without the earlier samples that its gate refuses; these are counted."""
        gate, message = self.gates.get(key), accepted.message
        if gate is None or not isinstance(message, SampledPose) or not message.history:
            return accepted
        kinds = [gate.refusal_of_earlier(pose) for pose in message.history]
        for kind in kinds:
            if kind is not None:
                self._count(kind, key, recv_ns)
        sound = tuple(pose for pose, kind in zip(message.history, kinds, strict=True) if kind is None)
        return accepted._replace(message=replace(message, history=sound))

    def counters(self) -> dict[str, int]:
        """Return the numbers of messages received, duplicated, rejected, of another run, and quarantined by kind."""
        return {
            "received": self.intake.n_accepted,
            "duplicates": self.intake.n_duplicates,
            "rejected": self.intake.n_rejected,
            **self.intake.counters(),
            **{f"{QUARANTINED}.{kind}": self.n_quarantined[kind] for kind in get_args(Kind)},
        }
