"""Commands on the certificates of a run on several hosts: ``tis certs init|issue|show``."""

from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, get_args

import typer
from rich.markup import escape

from tis.common.errors import EXIT_OK, DataError, Fault, InputError
from tis.common.extras import GET_HOSTS
from tis.deploy.cli.group import Commands, JsonOption, ScenarioArg
from tis.deploy.present.table import Column, Table
from tis.deploy.shell.guard import ERR, OUT, can_certify, print_json, print_warnings, words_to

if TYPE_CHECKING:
    from tis.deploy.tools.certificates import Certificate

app = Commands(no_args_is_help=True, help="Certificates for hosts that must not trust their network.")

FolderOption = Annotated[Path, typer.Option("--folder", help="Folder of the certificates.")]
HostOption = Annotated[
    list[str] | None,
    typer.Option("--host", metavar="ADDRESS", help="Address or name of netem's host, by which the others connect."),
]
DaysOption = Annotated[
    int | None, typer.Option("--days", min=1, max=365, help="Validity of the certificate, in days; by default 30.")
]
PasswordOption = Annotated[
    Path | None,
    typer.Option("--password-file", help="File with the password of the authority's key; its owner's only."),
]
_FOLDER = Path("certs")


@app.command(example="tis certs init --host 192.168.1.5")
def init(
    folder: FolderOption = _FOLDER,
    hosts: HostOption = None,
    days: DaysOption = None,
    password_file: PasswordOption = None,
    as_json: JsonOption = False,
) -> int:
    """Create an authority, and certificates for surgeon, netem and patient.

    Then copy FOLDER/surgeon to the surgeon's host, and so on; FOLDER/ca stays
    here: who has its key can act as anybody. With --password-file that key is
    encrypted.
    """
    _check_extra()
    from tis.common.channels import Side
    from tis.deploy.tools.certificates import check_hosts, issue, new_authority

    check_hosts(hosts or ())
    password = _password(password_file)
    new_authority(folder, password)
    found = [issue(folder, name, hosts or () if name == "netem" else (), days, password) for name in get_args(Side)]
    _print(found, as_json)
    words_to(as_json).print(
        escape(f"Each host needs the folder of its own names only, such as {folder / 'surgeon'}."), soft_wrap=True
    )
    if not hosts:
        ERR.print(
            "netem's certificate is for loopback only; for other hosts: tis certs issue netem --host ADDRESS",
            style="yellow", soft_wrap=True,
        )  # fmt: skip
    return EXIT_OK


@app.command(example="tis certs issue operator")
def issue(
    name: Annotated[str, typer.Argument(metavar="NAME", help="surgeon, netem, patient, or a further client.")],
    folder: FolderOption = _FOLDER,
    hosts: HostOption = None,
    days: DaysOption = None,
    password_file: PasswordOption = None,
    as_json: JsonOption = False,
) -> int:
    """Create or renew the certificate of one name.

    A further client may observe a run, change its network, or end emergency
    stops, if the scenario lists its name: security.observers,
    security.control, patient.safety.releasers. It connects with
    -c FOLDER/NAME/zenoh.json5.
    """
    _check_extra()
    from tis.deploy.tools.certificates import issue as issue_certificate

    _print([issue_certificate(folder, name, hosts or (), days, _password(password_file))], as_json)
    return EXIT_OK


@app.command(example="tis certs request scenario.yaml --only surgeon")
def request(
    scenario: ScenarioArg,
    folder: FolderOption = _FOLDER,
    only: Annotated[
        list[str] | None, typer.Option("--only", metavar="NAME", help="This name of the scenario only; repeatable.")
    ] = None,
    hosts: HostOption = None,
) -> int:
    """Make keys, and requests for certificates of another authority, such as a hospital's.

    A name is a side, or one in security.control, security.observers or
    patient.safety.releasers. Make each on the host that uses it: then no key
    travels. FOLDER/requests/NAME/request.pem goes to the authority; what comes
    back is taken into use by tis certs accept.
    """
    _check_extra()
    from tis.common.runtime.credentials import certified_names
    from tis.deploy.run.resolve import resolve
    from tis.deploy.tools.certificate_requests import request as request_certificate

    names = certified_names(resolve(scenario, (), None, None))
    foreign = sorted(set(only or ()) - set(names))
    if foreign:
        rule = f"must be a name of the scenario: {', '.join(names)}"
        raise InputError(Fault("tis certs", "--only", rule, ", ".join(foreign)))
    for name in names:
        if not only or name in only:
            OUT.print(str(request_certificate(folder, name, hosts or ())), soft_wrap=True, markup=False)
    return EXIT_OK


@app.command(example="tis certs accept surgeon --certificate surgeon.pem --ca hospital.pem")
def accept(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The name of the request.")],
    certificate: Annotated[Path, typer.Option("--certificate", help="What came back from the authority, in PEM.")],
    authorities: Annotated[
        Path,
        typer.Option("--ca", help="Certificates of the authority, in PEM; the same on all hosts."),
    ],
    folder: FolderOption = _FOLDER,
    as_json: JsonOption = False,
) -> int:
    """Take the certificate that an authority made of a request into use; a side that runs renews its connection."""
    _check_extra()
    from tis.common.runtime.credentials import read_certificates
    from tis.deploy.tools.certificate_requests import accept as accept_certificate

    given = read_certificates(certificate, authorities)
    _print([accept_certificate(folder, name, *given)], as_json)
    return EXIT_OK


@app.command(example="tis certs revoke operator")
def revoke(
    name: Annotated[str, typer.Argument(metavar="NAME", help="The name that must not be let in any more.")],
    folder: FolderOption = _FOLDER,
) -> int:
    """Write a name to FOLDER/revoked.txt; netem, where the file is in its folder, shuts it out within a second.

    The name stays out, whatever its certificate, until its line is gone.
    """
    _check_extra()
    from tis.deploy.tools.certificates import revoke as revoke_name

    line = revoke_name(folder, name)
    text = f"{folder / 'revoked.txt'} has: {line}; copy it into the folder of the certificates of every host"
    OUT.print(text, soft_wrap=True, markup=False)
    return EXIT_OK


@app.command(example="tis certs show")
def show(folder: FolderOption = _FOLDER, as_json: JsonOption = False) -> int:
    """List the certificates, for whom they are and how long they are valid; exit code 4 if one cannot be used."""
    _check_extra()
    from tis.common.runtime.credentials import soon_text
    from tis.deploy.tools.certificates import certificates

    found = certificates(folder)
    _print(found, as_json)
    for each in found:
        left = each.days_left(datetime.now(UTC))
        if left is not None and left > 0:
            print_warnings(ERR, *soon_text(each.name, left))
    return DataError.exit_code if any(each.fault for each in found) else EXIT_OK


def _print(found: "list[Certificate]", as_json: bool) -> None:
    now = datetime.now(UTC)
    if as_json:
        print_json(
            [
                {
                    "name": each.name,
                    "hosts": each.hosts,
                    "until": None if each.until is None else each.until.isoformat(),
                    "fault": each.fault,
                }
                for each in found
            ]
        )
        return
    from tis.deploy.present.table import PLAIN

    rows = []
    for each in found:
        left = each.days_left(now)
        until = "-" if each.until is None else f"{each.until:%Y-%m-%d %H:%M} UTC"
        days = "-" if left is None else f"{left:.0f}"
        rows.append((each.name, until, days, each.fault or ", ".join(each.hosts)))
    columns = [Column(head, words=True, wraps=True) for head in ("name", "valid until", "days left", "for")]
    OUT.print(Table("", columns, rows).terminal(PLAIN._replace(padding=(0, 1, 0, 1))))


def _password(file: Path | None) -> bytes | None:
    from tis.common.runtime.credentials import read_secret

    if file is None:
        return None
    secret = read_secret(file)
    if not secret:
        raise InputError(Fault(str(file), "", "must hold a password"))
    return secret


def _check_extra() -> None:
    if not can_certify():
        raise InputError(Fault("tis certs", "", f"needs the package cryptography: {GET_HOSTS}"))
