"""Emergency stops at the patient: requests on a key of their own, which no emulated queue delays."""

from dataclasses import dataclass

from pydantic import ValidationError

from common.channels import stop_key, stopped_key
from common.messages import EmergencyStop
from common.node import Arrival, Emission, Output, Record
from common.records import REJECTED, Rejected
from common.safety_records import STOPS, StopNote


@dataclass
class EmergencyStops:
    """Reads requests to stop or to release, and confirms each one; repeated ones are confirmed again."""

    session: str
    is_stopped: bool = False
    n_stops: int = 0
    n_rejected: int = 0

    def __post_init__(self) -> None:
        self.key, self.answer_key = stop_key(self.session), stopped_key(self.session)

    def take(self, arrival: Arrival) -> list[Output]:
        """Return the confirmation and the record of a request; what is none is counted, and rejected."""
        try:
            request = EmergencyStop.model_validate_json(arrival.payload)
        except ValidationError as error:
            self.n_rejected += 1
            reason = f"the payload is no EmergencyStop: {error.error_count()} faults"
            head = arrival.payload[:32].hex()
            note = Rejected(key=arrival.key, recv_ns=arrival.recv_ns, reason=reason, head_hex=head)
            return [Record(REJECTED, arrival.recv_ns, note)]
        answer: list[Output] = [Emission("east", self.answer_key, arrival.payload, b"", lambda _: ())]
        if request.stop == self.is_stopped:
            return answer
        self.is_stopped = request.stop
        self.n_stops += request.stop
        stop_note = StopNote(at_ns=arrival.recv_ns, stop=request.stop, reason=request.reason)
        return [*answer, Record(STOPS, arrival.recv_ns, stop_note)]
