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
from types import TracebackType
from typing import Any, Final, NamedTuple, Self

from common.errors import DataError, Fault, InputError, PeerError
from deploy.compare.cells.cell import Cell
from deploy.compare.cells.digests import file_digest, software_digest
from deploy.compare.engine.shipment import perform_away, shipment_of, shipped_files
from deploy.compare.engine.workers import AHEAD, Failure, Result, Unit, first_done
from deploy.shell.extras import GET_CLUSTER

_OPTION: Final = "--scheduler"
_PACKAGE: Final = "tis-testbed"
_CONNECT_S: Final = 10
_FIRST_WORKER_S: Final = 30.0
_LOOK_EVERY_S: Final = 1.0
_LOST: Final = (OSError, asyncio.TimeoutError, TimeoutError, CancelledError)
"""What calls of a client raise when its scheduler is gone; Dask's `CommClosedError` is an `OSError`."""


class _Submitted(NamedTuple):
    """Unit with the file of its models, the workers that may compute it, and the number of earlier tries."""

    unit: Unit
    model_file: Path | None
    workers: frozenset[str]
    n_before: int


class Software(NamedTuple):
    """Version of tis, and the digest of all code and libraries behind a result."""

    version: str
    digest: str

    def __str__(self) -> str:
        return f"tis {self.version} ({self.digest})"


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
        self._connect()
        try:
            self._wait_for_workers()
        except BaseException:
            self._client.close(timeout=_CONNECT_S)
            raise
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        with contextlib.suppress(*_LOST):  # closing a lost connection fails again
            self._executor.shutdown(wait=False)
            self._contents.clear()
            self._client.close(timeout=_CONNECT_S)  # the scheduler drops what only this client wanted

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
        paths = shipped_files(unit, model_file)
        digests = {name: file_digest(path) for name, path in paths.items()}
        contents = {name: self._content(path, digests[name]) for name, path in paths.items()}
        packed, key = pickle.dumps(shipment_of(unit, digests)), _key(unit, n_before)
        workers = frozenset(self._n_threads)
        with self._connected():
            future = self._executor.submit(_perform_on_worker, packed, contents, key=key, workers=[*workers])
        self._pending[future] = _Submitted(unit, model_file, workers, n_before)

    def _connect(self) -> None:
        """Connect to the scheduler, and compare its version with the client's."""
        try:
            import distributed
        except ModuleNotFoundError:
            raise InputError(Fault(_OPTION, "", f"needs Dask: {GET_CLUSTER}", self._address)) from None
        # Dask's own lines on a lost connection would stand between ours.
        for name in ("distributed", "distributed.client"):
            logging.getLogger(name).setLevel(logging.CRITICAL)
        try:
            self._client = _within(2 * _CONNECT_S, lambda: _client(distributed.Client, self._address))
        except _LOST as error:
            reason = f"no Dask scheduler answers within {_CONNECT_S} s"
            raise PeerError(Fault(_OPTION, "", reason, self._address)) from error
        except (ValueError, TypeError) as error:
            rule = "must be the address of a Dask scheduler, tcp://HOST:8786"
            raise InputError(Fault(_OPTION, "", rule, self._address)) from error
        except Exception as error:  # whatever Dask makes of another program's answer
            rule = "what answers there is no Dask scheduler"
            raise PeerError(Fault(_OPTION, "", rule, self._address)) from error
        self._executor = self._client.get_executor(retries=0)
        with self._connected():
            found = self._client.get_versions(packages=[_PACKAGE])["scheduler"]["packages"].get(_PACKAGE)
        if found != _here().version:
            has = "no tis" if found is None else f"tis {found}"
            self._client.close(timeout=_CONNECT_S)
            raise PeerError(Fault(_OPTION, "", f"the scheduler has {has}, this is {_here()}", self._address))

    def _wait_for_workers(self) -> None:
        """Wait for the first worker that can be used."""
        begun_s = time.monotonic()
        self._look()
        if not self._n_threads and not self._refused:
            self._notify(f"{self._address} has no worker yet: start `dask worker {self._address} --nthreads 1`")
        while not self._n_threads:
            if self._refused:
                raise PeerError([Fault(_OPTION, "", text) for text in self._refused.values()])
            if time.monotonic() - begun_s > _FIRST_WORKER_S:
                rule = f"no worker joined the scheduler within {_FIRST_WORKER_S:g} s"
                raise PeerError(Fault(_OPTION, "", rule, self._address))
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
            found = self._software(new) if new else {}
        before = set(self._n_threads)
        self._n_threads = {address: n for address, n in self._n_threads.items() if address in there}
        self._refused = {address: fault for address, fault in self._refused.items() if address in there}
        for address, software in found.items():
            if software == str(_here()):
                self._n_threads[address] = there[address]
                continue
            self._refused[address] = f"{address}: refused: it has {software}, this is {_here()}"
            if before:  # otherwise they are named together
                self._notify(self._refused[address])
        self._looked_s = time.monotonic()
        if before and not self._n_threads:
            self._notify(f"{self._address} has no worker left: what is stored stays, and a new worker goes on")
        if set(self._n_threads) != before:
            self._resubmit_strays()

    def _software(self, addresses: Sequence[str]) -> dict[str, str]:
        """Return the software of workers, in words; one that gives no answer is left to the next look."""
        versions = self._client.get_versions(packages=[_PACKAGE])
        here, of_workers = versions["client"]["packages"], versions["workers"]
        found = {}
        for address in addresses:
            packages = (of_workers.get(address) or {}).get("packages")
            if packages is None:
                continue
            # First what decides whether the worker can run the question for its code.
            if packages["python"].split(".")[:2] != here["python"].split(".")[:2]:
                found[address] = f"Python {packages['python']} instead of {here['python']}"
            elif packages.get(_PACKAGE) != here[_PACKAGE]:
                found[address] = "no tis" if packages.get(_PACKAGE) is None else f"tis {packages[_PACKAGE]}"
            else:
                answers = self._client.run(_software_digest_of(), workers=[address], on_error="ignore")
                if address in answers:
                    found[address] = str(Software(packages[_PACKAGE], answers[address]))
        return found

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
            try:
                content = file.read_bytes()
            except OSError as error:
                raise DataError(Fault(str(file), "", f"cannot be read: {error.strerror}")) from None
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
        except _LOST as error:
            raise _lost(self._address) from error


def _client(make: Any, address: str) -> Any:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # mismatched versions: they are compared afterwards
        return make(address, timeout=_CONNECT_S, set_as_default=False)


def _within(seconds: float, call: Callable[[], Any]) -> Any:
    """Return what a call returns; raises what it raises, and `RuntimeError` where it takes too long.

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
        raise RuntimeError(f"no answer within {seconds} s")
    return answer.result()


def _here() -> Software:
    return Software(importlib.metadata.version(_PACKAGE), software_digest())


def _software_digest_of() -> Callable[[], str]:
    """Return a question for the digest of a worker's software; its code travels with it, as it is not a module's."""

    def ask() -> str:
        try:
            from deploy.compare.cells.digests import software_digest

            return software_digest()
        except Exception as error:
            return f"{type(error).__name__}: {error}"

    return ask


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
    return PeerError(Fault(_OPTION, "", rule, address))
