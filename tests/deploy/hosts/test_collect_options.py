"""The uses of `tis collect`, and options that contradict each other."""

from pathlib import Path

import pytest

from tis.common.errors import InputError
from tis.deploy.hosts.collect import Asked, check_options


@pytest.mark.parametrize(
    ("asked", "kind"),
    [
        (Asked(["hosts.yaml"], None, [], [], None), "hosts"),
        (Asked(["conf/hosts.yaml"], None, [], [], "20260102_030405_s"), "hosts"),
        (Asked(["tcp/10.0.0.1:7450", "tls/10.0.0.2:7450"], None, [], [], None), "zenoh"),
        (Asked([], None, [], ["tls/10.0.0.1:7450"], None), "zenoh"),
        (Asked([], Path("out"), ["tcp/10.0.0.1:7450"], [], None), "offer"),
        (Asked([], Path("out"), [], ["tcp/10.0.0.1:7450"], None), "offer"),
    ],
)
def test_each_use_is_known_by_its_options(asked: Asked, kind: str) -> None:
    assert check_options(asked) == kind


@pytest.mark.parametrize(
    ("asked", "options"),
    [
        (Asked([], None, [], [], None), ["HOSTS_FILE"]),
        (Asked(["h.yaml", "g.yaml"], None, [], [], None), ["HOSTS_FILE"]),
        (
            Asked(["h.yaml"], None, ["tcp/10.0.0.1:1"], ["tcp/10.0.0.1:1"], None),
            ["HOSTS_FILE", "--connect", "--listen"],
        ),
        (Asked(["tcp/10.0.0.1:1"], None, [], ["tcp/10.0.0.1:2"], "r"), ["--run", "--listen"]),
        (Asked(["h.yaml"], None, [], [], "../run"), ["--run"]),
        (Asked(["h.yaml"], Path("out"), [], [], None), ["--offer", "--connect, --listen"]),
        (Asked([], Path("out"), ["tcp/10.0.0.1:1"], ["tcp/10.0.0.1:2"], None), ["--listen"]),
        (Asked(["tcp/10.0.0.1"], None, [], ["x"], None), ["--listen", "ENDPOINT", "--listen"]),
    ],
)
def test_all_contradictions_are_named_at_once(asked: Asked, options: list[str]) -> None:
    with pytest.raises(InputError) as caught:
        check_options(asked)
    assert [fault.field for fault in caught.value.faults] == options
