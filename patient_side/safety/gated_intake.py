"""Reception at the patient: what the intake decodes and the gates admit; the rest is quarantined."""

from collections import Counter, deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, get_args

from msgspec.structs import replace

from tis.common.intake import Accepted, Intake
from tis.common.messages import Pose, SampledPose, position_m
from tis.common.node import Arrival, Record
from tis.common.safety_records import QUARANTINE, QUARANTINED, QuarantineNote
from tis.common.units import NS_PER_S
from tis.patient_side.safety.gate import Kind, StreamGate

# Evidence of forgery: two contents under one number, and set points that the patient did not send.
#
# Nobody who is honest sends either. A few within a second are evidence; a single one may be a fault of a program.

N_EVIDENCE: Final = 3
"""Contradictions within a second that are evidence."""
_WITHIN_NS: Final = NS_PER_S
_MAX_TOLD_PER_S: Final = 10


@dataclass
class Evidence:
    """Contradictions of one kind, by their arrivals; ``begun_ns`` is the arrival that first made them evidence.

    Oracle: arrivals with literal instants, test_evidence.
    """

    n: int = 0
    begun_ns: int | None = None
    _until_ns: int = 0
    _latest_ns: deque[int] = field(default_factory=lambda: deque(maxlen=N_EVIDENCE), repr=False)
    _told_ns: deque[int] = field(default_factory=lambda: deque(maxlen=_MAX_TOLD_PER_S), repr=False)

    def note(self, recv_ns: int) -> None:
        """Count a contradiction: three within a second are evidence, and each further one prolongs it."""
        self.n += 1
        self._latest_ns.append(recv_ns)
        is_new = len(self._latest_ns) == N_EVIDENCE and recv_ns - self._latest_ns[0] < _WITHIN_NS
        if is_new or self.holds(recv_ns):
            self._until_ns = recv_ns + _WITHIN_NS
            self.begun_ns = recv_ns if self.begun_ns is None else self.begun_ns

    def holds(self, now_ns: int) -> bool:
        """Tell whether there is evidence now, which there is until a second after the last contradiction."""
        return now_ns < self._until_ns

    def is_to_be_logged(self, recv_ns: int) -> bool:
        """Tell whether one more is to be logged, where a flood must not fill the log: ten a second are."""
        if len(self._told_ns) == _MAX_TOLD_PER_S and recv_ns - self._told_ns[0] < NS_PER_S:
            return False
        self._told_ns.append(recv_ns)
        return True


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
