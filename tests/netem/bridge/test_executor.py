"""A serial executor: the order of acts, calls from within an act, and its end."""

import threading

from tis.netem.bridge.standstill import SerialExecutor


def executor(errors: list[BaseException]) -> SerialExecutor:
    return SerialExecutor("test", lambda: None, 0.01, errors.append)


def test_acts_are_performed_in_order_also_those_that_acts_post() -> None:
    errors: list[BaseException] = []
    done: list[int] = []
    one = executor(errors)

    def act(number: int) -> None:
        done.append(number)
        if number < 3:
            one.post(lambda: act(number + 10))  # as Zenoh does, which calls back within a call

    for number in range(1000):
        one.post(lambda number=number: act(number))  # type: ignore[misc]
    one.start()
    one.close()
    assert done[:1000] == list(range(1000))
    assert not errors


def test_posting_never_waits_for_an_act() -> None:
    errors: list[BaseException] = []
    free, done = threading.Event(), list[int]()
    one = executor(errors)
    one.start()
    one.post(free.wait)
    for number in range(2000):
        one.post(lambda number=number: done.append(number))  # type: ignore[misc]
    assert done == []
    free.set()
    one.close()
    assert done == list(range(2000))


def test_a_failed_act_is_reported_and_ends_the_thread() -> None:
    errors: list[BaseException] = []
    one = executor(errors)
    one.post(lambda: 1 // 0)
    one.start()
    one.close()
    assert [type(error) for error in errors] == [ZeroDivisionError]


def test_one_that_never_began_can_be_closed() -> None:
    executor([]).close()
