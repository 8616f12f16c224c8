"""Commands on the hosts of a run: `up`, `collect`, and `host`, which they start there."""

from pathlib import Path
from typing import Annotated

import typer

from deploy.cli.group import Commands
from deploy.cli.options import JsonOption, MergeOption, ReportOption, RunDirOption, VerboseOption
from deploy.shell.guard import ERR, guarded, words_to

app = Commands("Run on several hosts")

HostsArg = Annotated[
    Path, typer.Argument(metavar="HOSTS_FILE", help="File (YAML): the scenario, and each side's host.")
]


@app.command()
@guarded
def up(
    hosts: HostsArg,
    run_dir: RunDirOption = None,
    report: ReportOption = True,
    merge: MergeOption = True,
    verbose: VerboseOption = False,
    as_json: JsonOption = False,
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
    from deploy.hosts.up import UpOptions
    from deploy.hosts.up import up as run_up
    from deploy.run.conclude import Outputs

    outputs = Outputs(report, merge, verbose, as_json)
    return run_up(hosts, UpOptions(run_dir, wait_s, insecure), outputs, words_to(as_json), ERR)


@app.command(hidden=True)
@guarded
def host() -> int:
    """Obey one request of `tis up` or `tis collect`, on a host."""
    from deploy.hosts.agent.requests import obey, standard_streams

    return obey(*standard_streams())
