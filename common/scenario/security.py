"""Security of a run: who may connect to netem's two networks, and who may say what there."""

from typing import Annotated, Literal, get_args

from pydantic import AfterValidator, Field, StringConstraints

from tis.common.channels import Side
from tis.common.scenario.base import Part, RuleText

PersonName = Annotated[
    str,
    StringConstraints(pattern=r"^[A-Za-z0-9_][A-Za-z0-9_.-]{0,63}$"),
    RuleText("must be a name of up to 64 letters, digits, '_', '.' and '-', not beginning with '.' or '-'"),
]
"""Common name of a certificate, or name of a user."""


def _no_side(value: str) -> str:
    if value in get_args(Side):
        raise ValueError(f"must not be one of {', '.join(get_args(Side))}, whose rights are fixed")
    return value


_Names = tuple[Annotated[PersonName, AfterValidator(_no_side)], ...]


class _Clients(Part):
    """The clients of a run beside its sides."""

    control: _Names = Field(
        (), description="Names of further clients that may change the network while a run goes on, and observe it."
    )
    observers: _Names = Field(
        (), description="Names of further clients that may observe the run: its messages and netem's state."
    )


class _Signed(Part):
    """Whether surgeon and patient sign their messages."""

    sign: bool = Field(
        False,
        description="Surgeon and patient sign their messages, under a key for each run that netem does not have; "
        "what is not signed is not used.",
    )


class _SignedBySecret(_Signed):
    """Where no certificates prove a name."""

    secret_file: str = Field(
        "secret.txt",
        min_length=1,
        description="With sign: a file with a secret that surgeon and patient share, readable by its owner only; "
        "netem's host needs none. Relative to the current folder; hosts may differ.",
    )


class NoSecurity(_SignedBySecret):
    """Neither encryption nor authentication, for loopback: who connects may say anything but what only netem says."""

    kind: Literal["none"] = Field(description="none: neither encryption nor authentication.")


class Mtls(_Clients, _Signed):
    """TLS in both directions: netem and every client show a certificate, whose name decides what it may say."""

    kind: Literal["mtls"] = Field(description="mtls: encrypted, and each side proves its name with a certificate.")
    folder: str = Field(
        "certs",
        min_length=1,
        description="Folder of the certificates, as `tis certs init` makes it: one folder for each name. A host "
        "needs those of its own names only. Relative to the current folder; hosts may differ.",
    )


class Password(_Clients, _SignedBySecret):
    """A user and a password for each side: authenticated, but not encrypted, so for networks that nobody reads."""

    kind: Literal["password"] = Field(description="password: each side proves its name with a password.")
    file: str = Field(
        "passwords.txt",
        min_length=1,
        description="File with a line NAME:PASSWORD for each name, readable by its owner only. netem's host needs "
        "all lines, another host its own. Relative to the current folder; hosts may differ.",
    )


Security = Annotated[NoSecurity | Mtls | Password, Field(discriminator="kind")]
