"""What is said when there can be no page."""

import io

import pytest
from rich.console import Console

from tis.common.errors import InputError
from tis.common.extras import GET_REPORT
from tis.common.runtime.zenoh_session import ZenohOptions
from tis.deploy.run.resolve import resolve
from tis.deploy.view import page_process as beside
from tis.deploy.view.page_process import PageAddress, announce, page_beside


def test_without_bokeh_it_is_one_line_and_nothing_starts(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "can_report", lambda: False)
    with (
        pytest.raises(InputError) as raised,
        page_beside(PageAddress(), ("w", "e"), resolve("drive"), Console(file=io.StringIO()), ZenohOptions(), True),
    ):
        raise AssertionError("the block must not begin")
    assert str(raised.value) == f"tis run --view: needs Bokeh: {GET_REPORT}"


def test_the_address_is_printed_whole_and_opened_where_there_is_a_display(monkeypatch: pytest.MonkeyPatch) -> None:
    opened: list[str] = []
    monkeypatch.setattr("webbrowser.open", opened.append)
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    out, url = io.StringIO(), "http://lab.example:8000/?token=[bold]" + "x" * 100
    announce(url, Console(file=out, width=40))
    assert out.getvalue() == f"live page: {url}\n"
    assert opened == []
    monkeypatch.setenv("DISPLAY", ":0")
    announce(url, Console(file=out))
    assert opened == [url]
