"""The command that installs an extra fits the environment."""

import shlex
import sys
from email.message import Message
from importlib.metadata import Distribution
from pathlib import Path
from typing import Any

import pytest

from tis.common import extras
from tis.common.extras import GET_PANDAS, GET_REPORT, PACKAGE, install_command

EDITABLE = '{"dir_info": {"editable": true}, "url": "file:///home/me/my%20clone"}'
FOREIGN = '{"archive_info": {}, "url": "file:///tmp/tis.whl"}'
PIP = (sys.executable, "-m", "pip", "install")
RUNPIP = ("pipx", "runpip", PACKAGE, "install")
UV = ("uv", "pip", "install", "--python", "HERE")


class Installed(Distribution):
    """An installed package with two extras."""

    def __init__(self, origin: str | None) -> None:
        self.origin = origin

    def read_text(self, filename: str) -> str | None:
        return self.origin if filename == "direct_url.json" else None

    def locate_file(self, path: Any) -> Any:
        return path

    @property
    def metadata(self) -> Any:
        return Message()

    @property
    def requires(self) -> list[str]:
        return ["numpy>=2", "bokeh>=3.9; extra == 'report'", 'jinja2>=3.1 ; extra == "report"', "x; extra == 'dev'"]


@pytest.mark.parametrize(
    ("origin", "file", "content", "command"),
    [
        (
            EDITABLE,
            "pyvenv.cfg",
            "home = x",
            [sys.executable, "-m", "pip", "install", "-e", "/home/me/my clone[report]"],
        ),
        (FOREIGN, "pyvenv.cfg", "home = x", [*PIP, "bokeh>=3.9", "jinja2>=3.1"]),
        (FOREIGN, "pipx_metadata.json", "{}", ["pipx", "inject", PACKAGE, "bokeh>=3.9", "jinja2>=3.1"]),
        (
            EDITABLE,
            "pipx_metadata.json",
            "{}",
            [*RUNPIP, "-e", "/home/me/my clone[report]"],
        ),
        (None, "uv-receipt.toml", "", [*UV, "bokeh>=3.9", "jinja2>=3.1"]),
        (
            FOREIGN,
            "pyvenv.cfg",
            "uv = 0.9",
            [*UV, "bokeh>=3.9", "jinja2>=3.1"],
        ),
    ],
)
def test_each_environment_has_its_command(
    origin: str | None, file: str, content: str, command: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(extras, "_installed", lambda: Installed(origin))
    monkeypatch.setattr(extras, "find_spec", lambda _: object())
    (tmp_path / file).write_text(content)
    words = [str(tmp_path) if word == "HERE" else word for word in command]
    assert shlex.split(install_command(GET_REPORT, tmp_path)) == words
    assert shlex.split(install_command(GET_PANDAS, tmp_path))[-1] == "pandas"


def test_an_environment_without_pip_is_served_by_another_pip(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(extras, "_installed", lambda: None)
    monkeypatch.setattr(extras, "find_spec", lambda _: None)
    assert install_command(GET_REPORT, tmp_path).startswith(f"pip --python {tmp_path} install")


def test_every_extra_that_a_hint_names_is_one_of_the_package() -> None:
    installed = extras._installed()
    assert installed is not None
    hints = [one for name, one in vars(extras).items() if name.startswith("GET_") and one.name]
    assert [one.name for one in hints if not extras.packages_of(installed, one.name)] == []
