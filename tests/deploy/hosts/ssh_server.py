"""An ssh server in this process, on loopback, that runs commands for one known key."""

import asyncio
import contextlib
from collections.abc import AsyncIterator
from dataclasses import dataclass, field
from pathlib import Path

import asyncssh


@dataclass
class Server:
    """A running server: its port, the files that a client needs, and the commands it was sent."""

    port: int
    key: Path
    known_hosts: Path
    commands: list[str] = field(default_factory=list)
    cut_after_bytes: int | None = None
    """Of the next outputs; then the connection is cut."""
    connections: list[asyncssh.SSHServerConnection] = field(default_factory=list)
    children: list[asyncio.subprocess.Process] = field(default_factory=list)
    served: set["asyncio.Task[None]"] = field(default_factory=set)


@contextlib.asynccontextmanager
async def ssh_server(folder: Path, environment: dict[str, str]) -> AsyncIterator[Server]:
    host_key, client_key = (asyncssh.generate_private_key("ssh-ed25519") for _ in range(2))
    folder.mkdir(exist_ok=True)
    server = Server(0, folder / "id", folder / "known_hosts")
    client_key.write_private_key(server.key)
    client_key.write_public_key(folder / "authorized")

    class Noting(asyncssh.SSHServer):
        def connection_made(self, conn: asyncssh.SSHServerConnection) -> None:
            server.connections.append(conn)

    async def handle(process: "asyncssh.SSHServerProcess[bytes]") -> None:
        task = asyncio.create_task(_serve(server, process, environment))
        server.served.add(task)  # the connection's own task ends with it, the child must not
        await asyncio.shield(task)

    acceptor = await asyncssh.listen(
        "127.0.0.1", 0, server_host_keys=[host_key], authorized_client_keys=str(folder / "authorized"),
        server_factory=Noting, process_factory=handle, encoding=None,
    )  # fmt: skip
    server.port = acceptor.get_port()
    public = host_key.export_public_key().decode().strip()
    server.known_hosts.write_text(f"[127.0.0.1]:{server.port} {public}\n")
    try:
        yield server
    finally:
        acceptor.close()
        for connection in server.connections:
            connection.abort()
        for child in server.children:
            with contextlib.suppress(ProcessLookupError):
                child.terminate()
        await asyncio.gather(*server.served)
        await acceptor.wait_closed()


async def _serve(server: Server, process: "asyncssh.SSHServerProcess[bytes]", environment: dict[str, str]) -> None:
    """Run a command as sshd does: its input ends with the channel, and it gets no signal."""
    assert process.command is not None
    server.commands.append(process.command)
    pipe = asyncio.subprocess.PIPE
    child = await asyncio.create_subprocess_exec(
        "/bin/sh",
        "-c",
        process.command,
        stdin=pipe,
        stdout=pipe,
        stderr=pipe,
        env=environment,
        start_new_session=True,
    )
    server.children.append(child)
    assert child.stdin is not None
    assert child.stdout is not None
    assert child.stderr is not None

    async def feed() -> None:
        assert child.stdin is not None
        with contextlib.suppress(asyncssh.Error, ConnectionError):
            while data := await process.stdin.read(65536):
                child.stdin.write(data)
                await child.stdin.drain()
        child.stdin.close()

    async def pass_on(source: asyncio.StreamReader, sink: "asyncssh.SSHWriter[bytes]", cut: bool) -> None:
        n_bytes = 0
        while data := await source.read(1 << 14):
            with contextlib.suppress(asyncssh.Error, OSError):
                sink.write(data)
                await sink.drain()
            n_bytes += len(data)
            if cut and server.cut_after_bytes is not None and n_bytes >= server.cut_after_bytes:
                server.connections[-1].abort()

    reading = asyncio.create_task(feed())
    await asyncio.gather(pass_on(child.stdout, process.stdout, True), pass_on(child.stderr, process.stderr, False))
    code = await child.wait()
    reading.cancel()
    await asyncio.gather(reading, return_exceptions=True)
    child.stdin.close()
    with contextlib.suppress(asyncssh.Error, OSError):
        process.exit(code)
