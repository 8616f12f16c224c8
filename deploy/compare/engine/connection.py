"""Connection of a client to a Dask scheduler."""

import asyncio
import logging
import threading
import warnings
from collections.abc import Callable
from concurrent.futures import CancelledError, Future, wait
from typing import Any, Final

from tis.common.errors import GET_CLUSTER, Fault, InputError, PeerError

OPTION: Final = "--scheduler"
CONNECT_S: Final = 10
LOST: Final = (OSError, asyncio.TimeoutError, TimeoutError, CancelledError)
"""Errors of a client whose scheduler is gone; Dask's `CommClosedError` is an `OSError`."""


def connect(address: str) -> Any:
    """Return a Dask client of the scheduler at ``address``.

    Raises `InputError` for an impossible address or without Dask, and `PeerError` where no scheduler answers.
    """
    try:
        import distributed
    except ModuleNotFoundError:
        raise InputError(Fault(OPTION, "", f"needs Dask: {GET_CLUSTER}", address)) from None
    # Dask's own lines on a lost connection would stand between ours.
    for name in ("distributed", "distributed.client"):
        logging.getLogger(name).setLevel(logging.CRITICAL)
    try:
        return _within(2 * CONNECT_S, lambda: _client(distributed.Client, address))
    except LOST as error:
        rule = f"no Dask scheduler answers within {CONNECT_S} s"
        raise PeerError(Fault(OPTION, "", rule, address)) from error
    except (ValueError, TypeError) as error:
        rule = "must be the address of a Dask scheduler, tcp://HOST:8786"
        raise InputError(Fault(OPTION, "", rule, address)) from error
    except Exception as error:  # whatever Dask makes of another program's answer
        rule = f"what answers there is no Dask scheduler: {type(error).__name__}"
        raise PeerError(Fault(OPTION, "", rule, address)) from error


def _client(make: Any, address: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # mismatched versions: they are compared afterwards
        return make(address, timeout=CONNECT_S, set_as_default=False)


def _within(seconds: float, call: Callable[[], Any]) -> Any:
    """Return what a call returns; raises what it raises, and `TimeoutError` where it takes too long.

    Dask's own timeout ends no handshake with a program that waits for more.
    """
    answer: Future[Any] = Future()

    def answered() -> None:
        try:
            answer.set_result(call())
        except BaseException as error:
            answer.set_exception(error)

    threading.Thread(target=answered, daemon=True).start()
    done, _ = wait([answer], seconds)
    if not done:
        raise TimeoutError(f"no answer within {seconds} s")
    return answer.result()
