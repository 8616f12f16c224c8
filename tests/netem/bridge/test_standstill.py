"""A thread that does not return is told from one that waits, works or was suspended."""

from tis.netem.bridge.standstill import Pulse, StandstillWatch


def watching(*pulses: Pulse) -> StandstillWatch:
    watch = StandstillWatch(lambda *_: None, turn_s=0.5, standstill_s=2.0)
    for pulse in pulses:
        watch.watch(pulse)
    return watch


def test_one_deed_that_lasts_is_a_standstill_with_a_name_and_a_time() -> None:
    waits, stuck = Pulse("one"), Pulse("two")
    watch = watching(waits, stuck)
    with stuck.busy():
        assert [watch.look() for _ in range(6)] == [None, None, None, None, ("two", 2.0), ("two", 2.5)]
    assert watch.look() is None


def test_many_deeds_are_no_standstill() -> None:
    pulse = Pulse("one")
    watch = watching(pulse)
    for _ in range(20):
        with pulse.busy():
            assert watch.look() is None


def test_a_pulse_that_failed_waits_again() -> None:
    pulse = Pulse("one")
    try:
        with pulse.busy():
            raise ValueError
    except ValueError:
        pass
    assert not pulse.is_busy
