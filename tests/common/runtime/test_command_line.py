"""The command of a run as its logs show it: as it was typed, but for secrets."""

import shlex

import pytest

from tis.common.runtime.process import command_line

SECRET = "Tr0ub4dor"
PASSWORD = "transport/auth/usrpwd/password"


@pytest.mark.parametrize(
    ("typed", "shown"),
    [
        ("run default --set seed=3", "run default --set seed=3"),
        (f"run default --cfg {PASSWORD}:{SECRET}", f"run default --cfg {PASSWORD}:..."),
        (f"run default --cfg={PASSWORD}:{SECRET}", f"run default --cfg={PASSWORD}:..."),
        (f"netem --cfg 'transport/auth/usrpwd:{{user: \"a\", password: \"{SECRET}\"}}' -l tcp/0.0.0.0:1",
         "netem --cfg transport/auth/usrpwd:... -l tcp/0.0.0.0:1"),
        (f"netem --cfg {SECRET}", "netem --cfg ..."),
        (f"netem -e 'tls/h:1#root_ca_certificate_file=ca.pem;connect_private_key_base64={SECRET}'",
         "netem -e 'tls/h:1#root_ca_certificate_file=ca.pem;connect_private_key_base64=...'"),
        (f"netem --connect='tls/h:1#listen_private_key_base64={SECRET}'",
         "netem --connect=tls/h:1#listen_private_key_base64=..."),
        ("netem --cfg", "netem --cfg"),
    ],
)  # fmt: skip
def test_secrets_are_left_out_and_all_else_stays(typed: str, shown: str) -> None:
    found = command_line(shlex.split(typed))
    assert SECRET not in found
    assert shlex.split(found) == ["tis", *shlex.split(shown)]
