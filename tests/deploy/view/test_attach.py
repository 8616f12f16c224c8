"""`tis view` and `tis net` without an endpoint: the run on this machine, or what they wait for."""

import re
from pathlib import Path

import pytest

from tests.deploy.commands import call_in_one_line
from tis.common.errors import InputError
from tis.common.runtime import emulator_client, running
from tis.common.runtime.emulator_client import emulator_address
from tis.common.runtime.running import ALONE, Running

ONE = Running("tcp/127.0.0.1:4001", "tcp/127.0.0.1:4002", "one", "scenario one")
TWO = Running("tcp/127.0.0.1:4003", "tcp/127.0.0.1:4004", "two", "scenario two")


def test_the_only_run_of_the_machine_is_meant(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emulator_client, "sessions", lambda: [ONE])
    assert emulator_address(None, None, None, None)[:2] == (ONE.west, "one")
    assert emulator_address("tcp/127.0.0.1:5", None, None, None)[:2] == ("tcp/127.0.0.1:5", "tis")
    assert emulator_address(None, "other", None, None)[:2] == (running.WEST, "other")


def test_one_of_several_runs_has_to_be_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emulator_client, "sessions", lambda: [ONE, TWO])
    with pytest.raises(
        InputError, match=r"--connect: .*one \(--connect tcp/127.0.0.1:4001 --prefix one\); scenario two"
    ):
        emulator_address(None, None, None, None)
    assert emulator_address(None, "two", None, None)[:2] == (TWO.west, "two")


def test_view_names_only_options_that_it_has(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(emulator_client, "sessions", lambda: [ONE, TWO])
    code, _, err = call_in_one_line("view", "--wait-s", "0")
    assert code == 2
    assert f"--west {TWO.west} --east {TWO.east} --prefix two" in err
    _, help_text, _ = call_in_one_line("view", "--help")
    assert all(option in help_text for option in re.findall(r"(?<![\w-])--?[a-z][\w-]*", err))


@pytest.mark.parametrize("other", [Running(title=ALONE), Running()])
def test_neither_view_nor_net_chooses_between_a_run_and_an_emulator(
    monkeypatch: pytest.MonkeyPatch, other: Running
) -> None:
    monkeypatch.setattr(emulator_client, "sessions", lambda: [other, ONE])
    code, _, err = call_in_one_line("view", "--wait-s", "0")
    assert code == 2
    for one in (other, ONE):
        assert one.named_by(("--west", "--east")) in err
    with pytest.raises(InputError, match=f"{other.title} .*; {ONE.title}"):
        emulator_address(None, None, None, None)


def test_view_says_what_it_waits_for(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_RUNTIME_DIR", str(tmp_path))
    monkeypatch.setattr(emulator_client, "sessions", list)
    code, _, err = call_in_one_line("view", "--wait-s", "0")
    assert code == 3
    assert f"waiting for tis run, or for netem at {running.WEST}" in err


def test_view_reads_the_secret_of_its_stops_before_it_waits(tmp_path: Path) -> None:
    file = tmp_path / "secret.txt"
    file.touch(mode=0o600)
    file.write_text("short")
    code, _, err = call_in_one_line("view", "--wait-s", "0", "--secret-file", str(file))
    assert (code, "must have at least 16 bytes" in err) == (2, True), err
