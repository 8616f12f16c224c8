"""Requests to stop and to release, as they arrive at the patient."""

from typing import Any

from tis.common.messages import encode
from tis.common.node import Arrival
from tis.common.stop_messages import EmergencyStop, lock_of

STOP_KEY, RELEASE_KEY, ANSWER_KEY = "tis/@tis/stop", "tis/@tis/release", "tis/@tis/stopped"
SECRET = "0123456789abcdef"
LOCK = lock_of(SECRET)


def request(key: str, at_ns: int, **fields: Any) -> Arrival:
    return Arrival("east", key, encode(EmergencyStop(**fields)), b"", at_ns)


def a_stop(number: int, at_ns: int = 5, lock: str = "", reason: str = "") -> Arrival:
    return request(STOP_KEY, at_ns, stop=True, number=number, lock=lock, reason=reason)


def a_release(number: int, ends: int, at_ns: int = 5, secret: str = "") -> Arrival:
    return request(RELEASE_KEY, at_ns, stop=False, number=number, ends=ends, secret=secret)
