"""Plan of a transfer: nothing twice, nothing on top of another log."""

import hashlib

from hypothesis import given
from hypothesis import strategies as st

from tis.deploy.hosts.transfer.fetch import Fetch, Held, plan_fetch
from tis.deploy.hosts.transfer.offered_logs import OfferedLog


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _offer(source: bytes, n_part: int | None) -> OfferedLog:
    part = None if n_part is None or n_part > len(source) else _sha(source[:n_part])
    return OfferedLog(name="patient.mcap", n_bytes=len(source), sha256=_sha(source), part_sha256=part)


@given(
    source=st.binary(max_size=20), whole=st.binary(max_size=20) | st.none(), part=st.binary(max_size=20) | st.none()
)
def test_what_is_here_and_what_is_fetched_make_the_log_of_the_source(
    source: bytes, whole: bytes | None, part: bytes | None
) -> None:
    """Oracle: the bytes themselves."""
    held = Held(
        None if whole is None else _sha(whole), 0 if part is None else len(part), None if part is None else _sha(part)
    )
    offer = _offer(source, None if part is None else len(part))
    plan = plan_fetch(offer, held)
    if plan is None:
        assert whole == source
        return
    assert whole != source
    assert ((part or b"")[: plan.begin] + source[plan.begin :]) == source
    assert plan.begin == (len(part) if part and source.startswith(part) else 0)


def test_a_part_that_the_source_does_not_confirm_is_not_continued() -> None:
    held = Held(None, 3, _sha(b"abc"))
    assert plan_fetch(_offer(b"abcdef", None), held) == Fetch(_offer(b"abcdef", None), 0)
    assert plan_fetch(_offer(b"xbcdef", 3), held) == Fetch(_offer(b"xbcdef", 3), 0)
    assert plan_fetch(_offer(b"abcdef", 3), held) == Fetch(_offer(b"abcdef", 3), 3)
