import threading

import pytest

from tis.netem.bridge.alarm import Alarm

S = 1_000_000_000


class Ticking:
    """A clock that moves by a step at each look, and not otherwise."""

    def __init__(self, step_ns: int = S) -> None:
        self.step_ns = step_ns
        self.looks = 0

    def now_ns(self) -> int:
        self.looks += 1
        return self.looks * self.step_ns


def test_it_polls_the_clock_until_it_is_time_and_not_longer() -> None:
    clock = Ticking()
    alarm = Alarm()
    alarm.lead_ns = 100 * S  # so that nothing is left to sleep
    alarm.sleep(clock, 5 * S)
    assert clock.looks == 5
    alarm.sleep(clock, 5 * S)  # that has passed: looked once for the sleep and once to see
    assert clock.looks == 7


@pytest.mark.live
def test_a_ring_ends_the_sleep_and_one_that_came_before_counts() -> None:
    clock = Ticking(S // 1000)
    alarm = Alarm()
    alarm.ring()
    alarm.sleep(clock, S // 4)
    assert clock.looks == 1  # without a ring it would have looked until it is time
    ringing = threading.Timer(0.01, alarm.ring)
    ringing.start()
    alarm.sleep(clock, S // 4)
    ringing.join()
    assert clock.looks == 2
    alarm.sleep(clock, S // 4)  # the ring has been heard, so this one sleeps its time
    assert clock.looks == 250
