"""Emergency stops at the patient: requests on a key of their own, which no emulated queue delays."""

from collections import deque
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Final, NamedTuple

from pydantic import ValidationError

from common.channels import stop_key, stopped_key
from common.messages import EmergencyStop
from common.node import Arrival, Emission, Output, Record
from common.records import REJECTED, Rejected
from common.safety_records import STOPS, StopNote

_N_KNOWN: Final = 1000


class Taken(NamedTuple):
    """What a request leads to; ``is_new``: it is carried out, and not only confirmed again."""

    outputs: list[Output]
    is_new: bool


@dataclass
class EmergencyStops:
    """Reads requests to stop or to release, and confirms each one.

    A request is sent again until it is confirmed. A number that is known is confirmed, but not carried out again: a
    late repeat of a release must not undo a stop. Number 0 stands for none.
    """

    session: str
    is_stopped: bool = False
    n_rejected: int = 0
    _known: deque[int] = field(default_factory=lambda: deque(maxlen=_N_KNOWN))

    def __post_init__(self) -> None:
        self.key, self.answer_key = stop_key(self.session), stopped_key(self.session)

    def take(self, arrival: Arrival) -> Taken:
        """Return the confirmation and the record of a request; what is none is counted, and rejected."""
        try:
            request = EmergencyStop.model_validate_json(arrival.payload)
        except ValidationError as error:
            self.n_rejected += 1
            reason = f"the payload is no EmergencyStop: {error.error_count()} faults"
            head = arrival.payload[:32].hex()
            note = Rejected(key=arrival.key, recv_ns=arrival.recv_ns, reason=reason, head_hex=head)
            return Taken([Record(REJECTED, arrival.recv_ns, note)], is_new=False)
        answer = Emission("east", self.answer_key, request.model_dump_json().encode(), b"", lambda _: ())
        if request.number in self._known:
            return Taken([answer], is_new=False)
        if request.number:
            self._known.append(request.number)
        self.is_stopped = request.stop
        stop_note = StopNote(at_ns=arrival.recv_ns, stop=request.stop, reason=request.reason)
        return Taken([answer, Record(STOPS, arrival.recv_ns, stop_note)], is_new=True)

    def resume(self, payload: bytes | None) -> bool:
        """Go on after the last stop or release that an earlier process carried out; return whether it was a stop."""
        if payload is not None:
            with suppress(ValidationError):
                self.is_stopped = StopNote.model_validate_json(payload).stop
        return self.is_stopped
