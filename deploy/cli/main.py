"""Entry point of the command line ``tis``: groups of commands."""

from typing import Annotated, Any

import typer

from tis.common.runtime.process import run_to_end
from tis.deploy.cli import bench, certs, hosts, logs, net, runs, scenarios, sides, studies
from tis.deploy.cli.group import Commands
from tis.deploy.shell.guard import OUT, version_text

app = Commands(no_args_is_help=True)


def _show_version(requested: bool) -> None:
    if requested:
        OUT.print(version_text(), highlight=False)
        raise typer.Exit


@app.callback()
def tis(
    version_: Annotated[
        bool, typer.Option("--version", callback=_show_version, is_eager=True, help="Print the version and exit.")
    ] = False,
) -> None:
    """Run a surgeon, an impaired network and a patient as separate processes that talk over Zenoh."""


for group in (runs, hosts, logs, scenarios, studies, sides):
    app.add_typer(group.app)
app.add_typer(bench.app, name="bench", rich_help_panel="Studies")
app.add_typer(logs.audit_app, name="audit", rich_help_panel="Look at runs")
app.add_typer(net.app, name="net", rich_help_panel="Networks")
app.add_typer(certs.app, name="certs", rich_help_panel="One side, on a host of its own")


def main() -> Any:
    """Run the command line."""
    run_to_end(app)


if __name__ == "__main__":
    main()
