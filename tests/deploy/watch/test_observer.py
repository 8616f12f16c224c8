"""The observer on networks that not everybody may enter."""

from functools import partial
from pathlib import Path

import pytest

from tests.common.runtime.live_zenoh import soon
from tis.common.runtime.process import free_endpoints
from tis.common.runtime.zenoh_session import ZenohOptions, configure, open_router
from tis.deploy.view.server import ViewOptions
from tis.deploy.watch.observer import Observer

pytestmark = pytest.mark.live


def _is_there(observer: Observer) -> bool:
    return observer.attendance().connected


def test_zenoh_s_own_options_let_the_page_in(tmp_path: Path) -> None:
    users = tmp_path / "users.txt"
    users.write_text("lab:secret")
    west, east = free_endpoints()
    asks = (f"transport/auth/usrpwd/dictionary_file:'{users}'",)
    says = ("transport/auth/usrpwd/user:'lab'", "transport/auth/usrpwd/password:'secret'")
    with (
        open_router(configure("router", ZenohOptions(listen=[west], cfg=asks)), west),
        open_router(configure("router", ZenohOptions(listen=[east], cfg=asks)), east),
    ):
        for cfg, comes_in in ((says, True), (("transport/auth/usrpwd/user:'eve'",), False)):
            options = ViewOptions(west, east, cfg=cfg)
            observer = Observer({"west": options.west, "east": options.east}, "tis", zenoh=options.zenoh)
            observer.start()
            try:
                if comes_in:
                    assert soon(partial(_is_there, observer))
            finally:
                observer.stop()
            assert observer.attendance().connected == comes_in
            assert observer.error is None
