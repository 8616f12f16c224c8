"""TLS connections of this process: renewed with a new certificate, and of netem's name only.

A client's session outlives its link: it connects again within milliseconds, with the certificate that its files hold
then.
"""

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, Self

import zenoh

from tis.common.errors import Fault, InputError, PeerError
from tis.common.runtime.connections import address_of, cut
from tis.common.runtime.credentials import CERTIFICATE_FILE, KEY_FILE, tls_settings
from tis.common.runtime.signing import CertifiedKey, shows_certificate
from tis.common.signing import Identity

_EVERY_S: Final = 0.5
_PATIENCE_S: Final = 10.0
_ROUTER: Final = "netem"


def false_names(session: zenoh.Session) -> list[str]:
    """Return the names of routers that are not netem's.

    A certificate of the Web's authorities, which Zenoh's TLS trusts beside the run's own, is of another name.
    """
    links = [one for one in session.info.links() if one.dst.startswith("tls/")]
    return [one.auth_identifier or "nobody" for one in links if one.auth_identifier != _ROUTER]


@contextmanager
def of_netem_only(session: zenoh.Session, config: zenoh.Config, who: str) -> Iterator[None]:
    """Let a client that shows a certificate have links to netem only while the block lasts: others are cut.

    Raises `PeerError` where the router is of another name already.
    """
    if not shows_certificate(config):
        yield
        return
    if names := false_names(session):
        raise PeerError([Fault(who, "zenoh", f"its certificate is of {one}, must be netem's") for one in names])
    listener = session.info.declare_link_events_listener(_is_netems, history=True)
    try:
        yield
    finally:
        with suppress(zenoh.ZError):
            listener.undeclare()  # type: ignore[no-untyped-call]


def _is_netems(event: zenoh.LinkEvent) -> bool:
    """Tell whether netem was reached; a new link to another router is cut."""
    if event.kind != zenoh.SampleKind.PUT or not event.link.dst.startswith("tls/"):
        return False
    if event.link.auth_identifier == _ROUTER:
        return True
    cut({address_of(event.link.dst)})
    return False


class CertificateWatch:
    """Looks for a new certificate in ``folder``, and hands each to ``renew`` once, from a thread of its own.

    One that ``renew`` refuses by `InputError` may be half written: it is told once, and handed over again while it
    stays.
    """

    def __init__(self, folder: Path, renew: Callable[[bytes], None], tell: Callable[[str], None]) -> None:
        self._folder, self._renew, self._tell = folder, renew, tell
        self._known = self._content()
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._serve, name="certificate", daemon=True)
        self._thread.start()

    def close(self, wait_s: float | None = None) -> None:
        """End the thread; wait for it, or for so long at most."""
        self._over.set()
        self._thread.join(wait_s)

    def _content(self) -> bytes:
        with suppress(OSError):
            return (self._folder / CERTIFICATE_FILE).read_bytes()
        return b""

    def _serve(self) -> None:
        told = b""
        while not self._over.wait(_EVERY_S):
            content = self._content()
            if not content or content == self._known:
                continue
            try:
                self._renew(content)
                self._known = content
            except InputError as error:
                if told != content:
                    self._tell(f"the renewed certificate is not used: {error}")
                told = content


class CertifiedLink:
    """A client's link to netem with certificates, for as long as the block lasts.

    It is cut where the router is not of netem's name, and opened anew with a renewed certificate as soon as
    ``folder`` holds one. ``own`` signs with it from then on. ``tell`` gets what happened, and for how long.
    """

    def __init__(
        self, session: zenoh.Session, folder: Path, own: Identity | None, tell: Callable[[str], None]
    ) -> None:
        self._session, self._folder, self._own, self._tell = session, folder, own, tell
        self._opened = threading.Event()

    def __enter__(self) -> Self:
        self._listener = self._session.info.declare_link_events_listener(self._take, history=False)
        self._watch = CertificateWatch(self._folder, self._renew, self._tell)
        return self

    def __exit__(self, *_: object) -> None:
        self._watch.close(1.0)
        with suppress(zenoh.ZError):
            self._listener.undeclare()  # type: ignore[no-untyped-call]

    def _take(self, event: zenoh.LinkEvent) -> None:
        if _is_netems(event):
            self._opened.set()

    def _renew(self, certificate: bytes) -> None:
        tls_settings(self._folder, listens=False)
        if isinstance(self._own, CertifiedKey):
            try:
                self._own.renew(certificate, (self._folder / KEY_FILE).read_bytes())
            except (OSError, ValueError, TypeError) as error:
                raise InputError(Fault(str(self._folder), "", str(error))) from None
        ends = {address_of(one.dst) for one in self._session.info.links()}
        self._opened.clear()
        begun_s = time.monotonic()
        cut(ends)
        if self._opened.wait(_PATIENCE_S):
            gap_ms = 1e3 * (time.monotonic() - begun_s)
            self._tell(f"the certificate was renewed: the connection to netem was open again after {gap_ms:.0f} ms")
        else:
            self._tell(f"the certificate was renewed, but netem was not reached again within {_PATIENCE_S:g} s")
