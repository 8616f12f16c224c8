"""Emergency stops at the patient: requests on a key of their own, which no emulated queue delays."""

from collections import deque
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
    _last: EmergencyStop | None = None
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
        answer = self._answer(request)
        if request.number in self._known:
            return Taken([answer], is_new=False)
        if request.number:
            self._known.append(request.number)
        self.is_stopped, self._last = request.stop, request
        stop_note = StopNote(at_ns=arrival.recv_ns, stop=request.stop, reason=request.reason)
        return Taken([answer, Record(STOPS, arrival.recv_ns, stop_note)], is_new=True)

    def reminder(self) -> list[Emission]:
        """Return the confirmation of the stop once more, for a netem that was started anew; none when released."""
        return [self._answer(self._last)] if self.is_stopped and self._last is not None else []

    def _answer(self, request: EmergencyStop) -> Emission:
        return Emission("east", self.answer_key, request.model_dump_json().encode(), b"", lambda _: ())
