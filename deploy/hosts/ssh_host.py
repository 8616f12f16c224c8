"""Hosts that are reached by ssh; a host whose key is not known is refused."""

import asyncio
from pathlib import Path
from typing import Any, Final

import asyncssh

from tis.common.errors import DataError, Fault, InputError, PeerError
from tis.deploy.hosts.host import RemoteProcess
from tis.deploy.hosts.hosts_file import SshHost
from tis.deploy.hosts.protocol import printable

_CONNECT_S: Final = 15.0
_KEEPALIVE_S: Final = 5
_MAX_MISSED: Final = 4


class Ssh:
    """One ssh connection, made again when it is lost."""

    def __init__(self, settings: SshHost, key: Path | None, known_hosts: Path) -> None:
        self.place = settings.place
        self._settings = settings
        self._key = key
        self._known_hosts = known_hosts
        self._connection: asyncssh.SSHClientConnection | None = None

    async def open(self) -> None:
        """Connect; raises `DataError`, `InputError` and `PeerError`."""
        keys = self._check_files()
        try:
            async with asyncio.timeout(_CONNECT_S):
                self._connection = await asyncssh.connect(
                    self._settings.address, self._settings.port, known_hosts=str(self._known_hosts), config=None,
                    keepalive_interval=_KEEPALIVE_S, keepalive_count_max=_MAX_MISSED, **self._user(), **keys,
                )  # fmt: skip
        except asyncssh.HostKeyNotVerifiable:
            rule = f"its host key is not in {self._known_hosts}: add it if it is the right one (ssh-keyscan, ssh)"
            raise self._fault(rule) from None
        except asyncssh.PermissionDenied as error:
            raise self._fault(f"does not let us in: {printable(error.reason)}") from None
        except TimeoutError:
            raise self._fault(f"does not answer within {_CONNECT_S:g} s") from None
        except asyncssh.Error as error:
            raise self._fault(f"ssh failed: {printable(error.reason)}") from None
        except OSError as error:
            raise self._fault(f"cannot be reached: {printable(error.strerror or str(error))}") from None

    async def start(self, *words: str) -> RemoteProcess:
        """Start ``tis``, over a new connection if the old one is lost; raises `PeerError`."""
        if self._connection is None or self._connection.is_closed():
            await self.open()
        assert self._connection is not None
        command = " ".join(("exec", self._settings.tis, *words))
        try:
            process = await self._connection.create_process(command, encoding=None)
        except (asyncssh.Error, OSError) as error:
            raise self._fault(f"cannot start a command: {printable(str(error))}") from None

        async def exit_code() -> int | None:
            await process.wait_closed()
            return process.returncode

        return RemoteProcess(process.stdin, process.stdout, process.stderr, exit_code, process.close)

    async def close(self) -> None:
        """End the connection; each process there sees the end of its input."""
        if self._connection is not None:
            self._connection.close()
            await self._connection.wait_closed()

    def _user(self) -> dict[str, Any]:
        return {} if self._settings.user is None else {"username": self._settings.user}

    def _check_files(self) -> dict[str, Any]:
        """Return the private key, if one is named; raises `DataError` when a file cannot be used."""
        try:
            self._known_hosts.read_bytes()
        except OSError as error:
            rule = f"cannot be read: {error.strerror}; it holds the keys of the hosts to trust"
            raise DataError(Fault(str(self._known_hosts), "", rule)) from None
        if self._key is None:
            return {}
        try:
            return {"client_keys": [asyncssh.read_private_key(self._key)]}
        except asyncssh.KeyImportError as error:
            raise InputError(Fault(str(self._key), "", f"is no private key: {printable(str(error))}")) from None
        except OSError as error:
            raise DataError(Fault(str(self._key), "", f"cannot be read: {error.strerror}")) from None

    def _fault(self, rule: str) -> PeerError:
        return PeerError(Fault(self.place, "", rule))
