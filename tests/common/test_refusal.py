import pytest

from tis.common.refusal import MEANING, Refusal, refusal_in, sender_in, thread_in, trouble_in

_AT = b"\x1b[2m2026-11-23T00:26:47.160013Z\x1b[0m "
_FROM = b"acc-0 ThreadId(05) "


def _line(level: str, target: str, text: str) -> bytes:
    return (
        _AT + f"\x1b[33m {level}\x1b[0m ".encode() + _FROM + f"\x1b[2m{target}\x1b[0m\x1b[2m:\x1b[0m {text}".encode()
    )


_TLS, _ACL = "zenoh_link_tls::unicast", "zenoh::net::routing::interceptor::access_control"
_ACCEPT = "zenoh_transport::unicast::establishment::accept"
_HINT = ". Hint: increase the system open file limit."


@pytest.mark.parametrize(
    ("line", "kind"),
    [
        (_line("WARN", _TLS, f"peer sent no certificates{_HINT}"), "no_certificate"),
        (_line("WARN", _TLS, f"invalid peer certificate: BadSignature{_HINT}"), "foreign_authority"),
        (_line("WARN", _TLS, f"invalid peer certificate: UnknownIssuer{_HINT}"), "foreign_authority"),
        (
            _line("WARN", _TLS, f"invalid peer certificate: certificate expired: verification time 1{_HINT}"),
            "expired",
        ),
        (_line("WARN", _TLS, f"invalid peer certificate: certificate not valid yet: 1{_HINT}"), "expired"),
        (_line("WARN", _TLS, f"invalid peer certificate: BadEncoding{_HINT}"), "bad_certificate"),
        (_line("WARN", _TLS, f"received corrupt message of type InvalidContentType{_HINT}"), "no_tls"),
        (_line("WARN", _TLS, f"tls handshake eof{_HINT}"), None),  # it gave up, and nobody refused it
        (_line("WARN", _TLS, f"received fatal alert: UnknownCA{_HINT}"), "false_netem"),
        (_line("INFO", _ACL, "5ae8 did not match any configured ACL subject. Default permission"), "unknown_name"),
        (_line("TRACE", "zenoh::net::routing::interceptor", "Msg intercepted!"), "not_permitted"),
        (_line("DEBUG", _ACCEPT, "UsrPwd extension - Recv InitSyn. Expected extension."), "no_password"),
        (_line("DEBUG", _ACCEPT, "UsrPwd extension - Recv OpenSyn. Invalid password."), "wrong_password"),
        (_line("DEBUG", _ACCEPT, "UsrPwd extension - Recv OpenSyn. Invalid user."), "wrong_password"),
        (_line("DEBUG", _ACCEPT, "New transport link accepted from 4 to 6"), None),
        (_line("DEBUG", _ACL, "Access control is enabled"), None),
        (b"Msg intercepted!", None),
        (b"", None),
        (b"\xff\xfe", None),
    ],
)
def test_each_refusal_has_its_kind(line: bytes, kind: Refusal | None) -> None:
    assert refusal_in(line) == kind
    assert kind is None or MEANING[kind]


_PEER = "Unable to connect to configured peer tls/127.0.0.1:1! "
_CLIENT = "zenoh::net::runtime::orchestrator"


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (f'{_PEER}: invalid peer certificate: certificate not valid for name "10.0.0.1"', "not for this address"),
        (f"{_PEER}: invalid peer certificate: BadSignature", "of another authority"),
        (f"{_PEER}: invalid peer certificate: certificate expired: verification time 1", "has expired"),
        (f"{_PEER}: invalid peer certificate: certificate does not allow extended key usage", "is not netem's"),
        (f"{_PEER}received fatal alert: CertificateExpired", "this side's certificate, which has expired"),
        (f"{_PEER}received fatal alert: DecryptError", "refuses this side's certificate"),
        ("Received a close message (reason GENERIC) in response to an OpenSyn on: tcp", "user or password"),
        ("Unable to connect to any of [Single(tls/127.0.0.1:1)]. Timeout!", None),
        (f"{_PEER}Connection refused", None),
    ],
)
def test_a_client_is_told_why_it_is_not_let_in(text: str, reason: str | None) -> None:
    found = trouble_in(_line("DEBUG", _CLIENT, text))
    assert (found is None) == (reason is None)
    assert reason is None or reason in str(found)


def test_lines_of_refusals_name_the_sender_as_far_as_zenoh_does() -> None:
    """As a real router of Zenoh 1.10.2 wrote them."""
    head = b"2026-11-27T19:46:55.383655Z TRACE  rx-1 ThreadId(10) zenoh::net::routing::interceptor::access_control: "
    zid = b"af28ca41ca5366087a687c44cd331699"
    subject = b"Interface(lo)+CertCommonName(surgeon)+Transport(Tls)+" + zid
    assert sender_in(head + zid + b" did not match any configured ACL subject. Default permission") == (
        zid.decode(),
        "",
        "",
    )
    line = head + zid + b" on " + subject + b" is unauthorized to Put (ingress) on tis/PSM2/servo_cp"
    assert sender_in(line) == (zid.decode(), "surgeon", "tis/PSM2/servo_cp")
    assert sender_in(line.replace(b"CertCommonName", b"Username")).name == "surgeon"
    cached = (
        head + b"Using cached result: " + zid + b" is unauthorized to Declare/Undeclare Queryable (ingress) on a/*"
    )
    assert sender_in(cached) == (zid.decode(), "", "a/*")
    assert sender_in(b"peer sent no certificates") == ("", "", "")
    assert thread_in(head) == b"ThreadId(10)"
