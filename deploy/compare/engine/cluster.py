"""Workers of a Dask cluster: they need this version of tis, and no disk that they share with the client.

A file that units read is a task of its own, whose result is the file's content: Dask brings it to each worker that
needs it once, and again where a worker was lost. Units and files are named by their digests.
"""

import asyncio
import contextlib
import importlib.metadata
import logging
import pickle
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import CancelledError, Future, wait
from pathlib import Path
from typing import Any, Final, NamedTuple, Self

from tis.common.errors import Fault, InputError, PeerError, file_faults
from tis.common.extras import GET_CLUSTER
from tis.deploy.compare.cells.cell import Cell
from tis.deploy.compare.cells.identity import file_digest, software_digest
from tis.deploy.compare.engine.shipment import perform_away, shipment_of, shipped_files
from tis.deploy.compare.engine.workers import AHEAD, Failure, Result, Unit, first_done
from tis.patient_side.models import own_estimators

# Connection of a client to a Dask scheduler.

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


# Software of a cluster's hosts, compared with the client's: only equal software gives equal results.

_PACKAGE: Final = "tis-testbed"


class Software(NamedTuple):
    """Version of tis, and the digest of all code and libraries behind a result."""

    version: str
    digest: str

    def __str__(self) -> str:
        return f"tis {self.version} ({self.digest})"


def here() -> Software:
    """Return the client's software."""
    return Software(importlib.metadata.version(_PACKAGE), software_digest())


def fault_of_scheduler(client: Any) -> str | None:
    """Return the difference between the scheduler's version of tis and the client's; None if there is none."""
    found = client.get_versions(packages=[_PACKAGE])["scheduler"]["packages"].get(_PACKAGE)
    return None if found == here().version else f"the scheduler has {_named(found)}, this is {here()}"


def software_of(client: Any, addresses: Sequence[str]) -> dict[str, str]:
    """Return the software of workers in words, by address; one that gives no answer is left out.

    It equals ``str(here())`` where version, code and libraries are the client's.
    """
    versions = client.get_versions(packages=[_PACKAGE])
    own, of_workers = versions["client"]["packages"], versions["workers"]
    found = {}
    for address in addresses:
        packages = (of_workers.get(address) or {}).get("packages")
        if packages is None:
            continue
        # First what decides whether the worker can run the question for its code.
        if packages["python"].split(".")[:2] != own["python"].split(".")[:2]:
            found[address] = f"Python {packages['python']} instead of {own['python']}"
        elif packages.get(_PACKAGE) != own[_PACKAGE]:
            found[address] = _named(packages.get(_PACKAGE))
        else:
            answers = client.run(_question(), workers=[address], on_error="ignore")
            if address in answers:
                found[address] = str(Software(packages[_PACKAGE], answers[address]))
    return found


def _named(version: str | None) -> str:
    return "no tis" if version is None else f"tis {version}"


def _question() -> Callable[[], str]:
    """Return a question for the digest of a worker's software; its code travels with it, as it is not a module's."""

    def ask() -> str:
        try:
            from tis.deploy.compare.cells.identity import software_digest

            return software_digest()
        except Exception as error:
            return f"{type(error).__name__}: {error}"

    return ask


_FIRST_WORKER_S: Final = 30.0
_LOOK_EVERY_S: Final = 1.0


class _Submitted(NamedTuple):
    """Unit with the file of its models, the workers that may compute it, and the number of earlier tries."""

    unit: Unit
    model_file: Path | None
    workers: frozenset[str]
    n_before: int


class Cluster:
    """Workers behind the Dask scheduler at ``address``; ``notify`` prints a notice.

    Workers that join later are used too. One with other software than the client's is refused, with a notice. Raises
    `InputError` for an impossible address, and `PeerError` for a scheduler that is not there, has another version or
    is lost, and where no worker can be used.
    """

    def __init__(self, address: str, notify: Callable[[str], None]) -> None:
        self._address = address
        self._notify = notify
        self._client: Any = None
        self._executor: Any = None
        self._n_threads: dict[str, int] = {}
        """Threads of the workers that are used, by address."""
        self._refused: dict[str, str] = {}
        self._looked_s = 0.0
        self._pending: dict[Future[Any], _Submitted] = {}
        self._contents: dict[str, Any] = {}
        """Dask's future of each file's content, by digest."""

    def __enter__(self) -> Self:
        self._client = connect(self._address)
        self._executor = self._client.get_executor(retries=0)
        try:
            with self._connected():
                fault = fault_of_scheduler(self._client)
            if fault is not None:
                raise PeerError(Fault(OPTION, "", fault, self._address))
            self._wait_for_workers()
        except BaseException:
            self._client.close(timeout=CONNECT_S)
            raise
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(*LOST):  # closing a lost connection fails again
            self._executor.shutdown(wait=False)
            self._contents.clear()
            self._client.close(timeout=CONNECT_S)  # the scheduler drops what only this client wanted

    def has_room(self) -> bool:
        """Tell whether another unit should be submitted: not while there is no worker."""
        return len(self._pending) < AHEAD * sum(self._n_threads.values())

    def submit(self, unit: Unit, model_file: Path | None) -> None:
        """Take a unit; Dask repeats it elsewhere where its worker dies, up to three times."""
        self._submit(unit, model_file, n_before=0)

    def completed(self) -> list[tuple[Unit, Result]]:
        """Return what was completed; see `Workers`."""
        self._look()
        if not self._pending:  # no worker is left
            time.sleep(_LOOK_EVERY_S)
        results: list[tuple[Unit, Result]] = []
        for future in first_done(self._pending, Future.cancelled):
            if future.cancelled():
                if results:  # they count; the next call raises
                    return results
                raise _lost(self._address)
            unit = self._pending.pop(future).unit
            error = future.exception()
            results.append((unit, future.result() if error is None else _failed(unit, error)))
        return results

    def _submit(self, unit: Unit, model_file: Path | None, n_before: int) -> None:
        own = own_estimators(unit.scenario)
        paths = shipped_files(unit, model_file, own)
        digests = {name: file_digest(path) for name, path in paths.items()}
        contents = {name: self._content(path, digests[name]) for name, path in paths.items()}
        packed, key = pickle.dumps(shipment_of(unit, digests, own)), _key(unit, n_before)
        workers = frozenset(self._n_threads)
        with self._connected():
            future = self._executor.submit(_perform_on_worker, packed, contents, key=key, workers=[*workers])
        self._pending[future] = _Submitted(unit, model_file, workers, n_before)

    def _wait_for_workers(self) -> None:
        """Wait for the first worker that can be used."""
        begun_s = time.monotonic()
        self._look()
        if not self._n_threads and not self._refused:
            self._notify(f"{self._address} has no worker yet: start `dask worker {self._address} --nthreads 1`")
        while not self._n_threads:
            if self._refused:
                raise PeerError([Fault(OPTION, "", text) for text in self._refused.values()])
            if time.monotonic() - begun_s > _FIRST_WORKER_S:
                rule = f"no worker joined the scheduler within {_FIRST_WORKER_S:g} s"
                raise PeerError(Fault(OPTION, "", rule, self._address))
            time.sleep(_LOOK_EVERY_S)
            self._look()
        for text in self._refused.values():
            self._notify(text)
        threads = ", ".join(f"{address} ({n})" for address, n in sorted(self._n_threads.items()))
        self._notify(f"workers (threads) of {self._address}: {threads}")

    def _look(self) -> None:
        """Look for workers that came or went, at most once a second; admit or refuse those that came."""
        if time.monotonic() - self._looked_s < _LOOK_EVERY_S:
            return
        with self._connected():
            there: dict[str, int] = self._client.nthreads()
            new = [address for address in there if address not in self._n_threads and address not in self._refused]
            found = software_of(self._client, new) if new else {}
        before = set(self._n_threads)
        self._n_threads = {address: n for address, n in self._n_threads.items() if address in there}
        self._refused = {address: fault for address, fault in self._refused.items() if address in there}
        for address, software in found.items():
            if software == str(here()):
                self._n_threads[address] = there[address]
                continue
            self._refused[address] = f"{address}: refused: it has {software}, this is {here()}"
            if before:  # otherwise they are named together
                self._notify(self._refused[address])
        self._looked_s = time.monotonic()
        if before and not self._n_threads:
            self._notify(f"{self._address} has no worker left: what is stored stays, and a new worker goes on")
        if set(self._n_threads) != before:
            self._resubmit_strays()

    def _resubmit_strays(self) -> None:
        """Submit anew the units whose workers are all gone, as Dask would wait for these."""
        for future, submitted in list(self._pending.items()):
            if not future.done() and self._n_threads and not submitted.workers & self._n_threads.keys():
                del self._pending[future]
                future.cancel()
                self._submit(submitted.unit, submitted.model_file, submitted.n_before + 1)

    def _content(self, file: Path, digest: str) -> Any:
        """Return Dask's future of a file's content."""
        if digest not in self._contents:
            with file_faults(file, "cannot be read"):
                content = file.read_bytes()
            with self._connected(), warnings.catch_warnings():
                warnings.simplefilter("ignore", UserWarning)  # a large graph: a trial may have 10 MB
                # `bytes` runs anywhere, so any worker may hold the content.
                self._contents[digest] = self._client.submit(bytes, content, key=f"file-{digest}")
        return self._contents[digest]

    @contextlib.contextmanager
    def _connected(self) -> Iterator[None]:
        """Raise `PeerError` where the scheduler turns out to be lost."""
        try:
            yield
        except LOST as error:
            raise _lost(self._address) from error


def _perform_on_worker(packed: bytes, contents: dict[str, bytes]) -> Result:
    from distributed import get_worker

    return perform_away(packed, contents, str(Path(get_worker().local_directory) / "tis"))


def _key(unit: Unit, n_before: int) -> str:
    """Return a unit's key for Dask: what two clients want at once is computed once."""
    kind = "cell" if isinstance(unit, Cell) else "timed" if unit.timed else "training"
    return f"{kind}-{unit.digest}" + (f"-{n_before}" if n_before else "")


def _failed(unit: Unit, error: BaseException) -> Failure:
    from distributed import KilledWorker

    if isinstance(error, KilledWorker):
        return Failure(unit.label, f"its worker died, {error.allowed_failures + 1} times (out of memory?)")
    return Failure(unit.label, f"{type(error).__name__}: {error}")


def _lost(address: str) -> PeerError:
    rule = "the connection to the scheduler is lost; the same command resumes"
    return PeerError(Fault(OPTION, "", rule, address))
