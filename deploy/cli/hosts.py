"""Commands on the hosts of a run: `up`, `collect`, and `host`, which they start there."""

from pathlib import Path
from typing import Annotated

import typer

from tis.deploy.cli.group import Commands, ConnectionOptions, OutputOptions, RunDirOption
from tis.deploy.shell.guard import ERR

app = Commands("Run on several hosts")

HostsArg = Annotated[
    Path, typer.Argument(metavar="HOSTS_FILE", help="File (YAML): the scenario, and each side's host.")
]


@app.command(example="tis up hosts.yaml")
def up(
    *,
    hosts: HostsArg,
    run_dir: RunDirOption = None,
    outputs: OutputOptions,
    wait_s: Annotated[
        float, typer.Option(min=0, max=86_400, help="A side gives up when the others are not there after so many s.")
    ] = 120.0,
    insecure: Annotated[
        bool, typer.Option("--insecure", help="netem listens beyond loopback although anybody may connect.")
    ] = False,
) -> int:
    """Run surgeon, netem and patient on their hosts, by ssh, and collect their logs into one run folder.

    All hosts are checked first; nothing starts if one has a fault. Ctrl-C ends
    all sides, and their logs are collected.
    """
    from tis.deploy.hosts.up import up as run_up

    return run_up(hosts, run_dir, wait_s, insecure, outputs.wanted, outputs.words, outputs.progress)


@app.command(example="tis collect hosts.yaml")
def collect(
    *,
    sources: Annotated[
        list[str] | None,
        typer.Argument(metavar="HOSTS_FILE | ENDPOINT", help="The hosts file of `tis up`, or endpoints of offers."),
    ] = None,
    run: Annotated[
        str | None, typer.Option(help="With a hosts file: name of the run there; by default the newest.")
    ] = None,
    run_dir: RunDirOption = None,
    offer: Annotated[
        Path | None, typer.Option(metavar="RUN_DIR", help="Offer the logs in this folder over Zenoh, until Ctrl-C.")
    ] = None,
    connect: Annotated[
        list[str] | None,
        typer.Option("--connect", "-e", help="With --offer: Zenoh endpoint of the collector, which listens."),
    ] = None,
    listen: Annotated[
        list[str] | None,
        typer.Option("--listen", "-l", help="Zenoh endpoint to listen on, to offer or to collect."),
    ] = None,
    wait_s: Annotated[
        float | None, typer.Option(min=0, help="Over Zenoh: give up after so many s; by default never.")
    ] = None,
    max_gb: Annotated[
        float, typer.Option(min=0.001, help="Largest size of all logs together; a host that offers more is refused.")
    ] = 50.0,
    outputs: OutputOptions,
    connection: ConnectionOptions,
) -> int:
    """Collect the logs of a run from its hosts into one folder, and summarise it.

    A transfer that was interrupted goes on where it stopped. Without ssh, each
    host offers its folder: tis collect --offer RUN_DIR --connect ENDPOINT, and
    one of them collects: tis collect --listen ENDPOINT --run-dir RUN_DIR.
    """
    from tis.deploy.hosts.collect import Asked, check_options

    asked = Asked(tuple(sources or ()), offer, tuple(connect or ()), tuple(listen or ()), run)
    kind = check_options(asked)
    if kind == "hosts":
        from tis.deploy.hosts.collect import collect_from_hosts

        return collect_from_hosts(
            Path(asked.sources[0]), run, run_dir, max_gb, outputs.wanted, outputs.words, outputs.progress
        )
    from tis.deploy.hosts.zenoh_logs import collect_over_zenoh, offer_logs

    if offer is not None:
        return offer_logs(offer, connection.zenoh(connect, listen), ERR)
    return collect_over_zenoh(
        connection.zenoh(sources, listen), run_dir, wait_s, max_gb, outputs.wanted, outputs.words, outputs.progress
    )


@app.command(hidden=True)
def host() -> int:
    """Obey one request of `tis up` or `tis collect`, on a host."""
    from tis.deploy.hosts.agent import obey, standard_streams

    return obey(*standard_streams())
