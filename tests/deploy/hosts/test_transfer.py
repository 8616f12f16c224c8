"""Collections from a source that breaks off, changes or lies."""

import asyncio
import hashlib
import os
from collections.abc import AsyncIterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import DataError, Fault, PeerError
from tis.deploy.hosts.log_offer import MAX_LOG_BYTES, OfferedLog, log_names, offered_logs, opened_log, read_range
from tis.deploy.hosts.transfer import Collection, Fetch, Held, plan_fetch

_LOG = bytes(range(250)) * 40
_BLOCK = 1000


def _sha(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@dataclass
class FakeSource:
    """A source in memory; after ``breaks_after`` bytes of each read the connection is gone."""

    logs: dict[str, bytes]
    breaks_after: int = 1 << 30
    place: str = "surgeon on 10.0.0.2"
    read_from: list[int] = field(default_factory=list)
    n_bytes: int = 0
    block: int = _BLOCK

    async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
        def part(name: str, data: bytes) -> str | None:
            n = parts.get(name)
            return None if n is None or n > len(data) else _sha(data[:n])

        return [
            OfferedLog(name=name, n_bytes=len(data), sha256=_sha(data), part_sha256=part(name, data))
            for name, data in self.logs.items()
        ]

    async def read(self, name: str, begin: int, end: int) -> AsyncIterator[bytes]:
        self.read_from.append(begin)
        for at in range(begin, end, self.block):
            if at - begin >= self.breaks_after:
                return
            block = self.logs[name][at : min(at + self.block, end)]
            self.n_bytes += len(block)
            yield block


def _collect(folder: Path, source: FakeSource) -> list[str]:
    told: list[str] = []
    asyncio.run(Collection(folder, told.append, pause_s=0).fetch_all(source))
    return told


def _files(folder: Path) -> dict[str, bytes]:
    return {path.name: path.read_bytes() for path in folder.iterdir()}


def test_a_transfer_that_breaks_goes_on_where_it_stopped(tmp_path: Path) -> None:
    source = FakeSource({"surgeon.mcap": _LOG}, breaks_after=3000)
    assert _collect(tmp_path, source) == [
        "surgeon.mcap from surgeon on 10.0.0.2: 10000 bytes, continued after 9000 bytes"
    ]
    assert source.read_from == [0, 3000, 6000, 9000]
    assert source.n_bytes == len(_LOG)
    assert _files(tmp_path) == {"surgeon.mcap": _LOG}


def test_a_source_that_brings_nothing_ends_the_collection_and_the_part_stays(tmp_path: Path) -> None:
    (tmp_path / "surgeon.mcap.part").write_bytes(_LOG[:4000])
    with pytest.raises(PeerError, match="stopped after 4000 of 10000 bytes"):
        _collect(tmp_path, FakeSource({"surgeon.mcap": _LOG}, breaks_after=0))
    assert _files(tmp_path) == {"surgeon.mcap.part": _LOG[:4000]}


def test_a_log_that_is_here_is_not_fetched_again(tmp_path: Path) -> None:
    source = FakeSource({"surgeon.mcap": _LOG, "surgeon_2.mcap": b"more"})
    _collect(tmp_path, source)
    before = source.n_bytes
    assert _collect(tmp_path, source) == ["surgeon.mcap is here already", "surgeon_2.mcap is here already"]
    assert source.n_bytes == before


def test_a_log_that_changed_at_its_source_starts_anew_and_one_that_grew_goes_on(tmp_path: Path) -> None:
    (tmp_path / "surgeon.mcap.part").write_bytes(b"x" + _LOG[1:4000])
    source = FakeSource({"surgeon.mcap": _LOG})
    _collect(tmp_path, source)
    assert source.read_from == [0]
    (tmp_path / "surgeon_2.mcap.part").write_bytes(_LOG)
    grown = FakeSource({"surgeon_2.mcap": _LOG + b"more"})
    _collect(tmp_path, grown)
    assert grown.read_from == [len(_LOG)]
    assert _files(tmp_path) == {"surgeon.mcap": _LOG, "surgeon_2.mcap": _LOG + b"more"}


def test_a_log_is_never_kept_without_the_digest_that_was_offered(tmp_path: Path) -> None:
    class Liar(FakeSource):
        async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
            [log] = await super().offered(parts)
            return [log.model_copy(update={"sha256": _sha(b"other")})]

    with pytest.raises(DataError, match="change while they are fetched"):
        _collect(tmp_path, Liar({"surgeon.mcap": _LOG}))
    assert _files(tmp_path) == {}


def test_a_source_that_sends_more_than_it_offers_fills_no_disk(tmp_path: Path) -> None:
    class Endless(FakeSource):
        async def read(self, name: str, begin: int, end: int) -> AsyncIterator[bytes]:
            while True:
                yield bytes(_BLOCK)

    with pytest.raises(DataError, match="more than it offered"):
        _collect(tmp_path, Endless({"surgeon.mcap": _LOG}))
    assert sum(map(len, _files(tmp_path).values())) <= len(_LOG)


@pytest.mark.parametrize("held", [b"", _LOG[:5000]], ids=["empty", "held"])
def test_more_than_the_collection_may_hold_is_refused_before_a_byte_is_read(tmp_path: Path, held: bytes) -> None:
    if held:
        (tmp_path / "netem.mcap").write_bytes(held)
    source = FakeSource({"surgeon.mcap": _LOG, "surgeon_2.mcap": _LOG})
    with pytest.raises(DataError, match=r"offers .* GB, and the logs together may have .*--max-gb"):
        asyncio.run(Collection(tmp_path, list[str]().append, max_bytes=len(_LOG) + 6000).fetch_all(source))
    assert source.n_bytes == 0


def test_a_log_larger_than_the_disk_is_refused_before_a_byte_is_read(tmp_path: Path) -> None:
    class Huge(FakeSource):
        async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
            return [OfferedLog(name="surgeon.mcap", n_bytes=MAX_LOG_BYTES, sha256=_sha(b""))]

    source = Huge({"surgeon.mcap": _LOG})
    with pytest.raises(DataError, match=r"offers 1099\.51 GB, and .* has .* GB free"):
        asyncio.run(Collection(tmp_path, list[str]().append, max_bytes=2 * MAX_LOG_BYTES).fetch_all(source))
    assert source.n_bytes == 0


def test_a_source_that_brings_a_byte_with_each_attempt_ends_the_collection(tmp_path: Path) -> None:
    source = FakeSource({"surgeon.mcap": _LOG}, breaks_after=1)
    source.block = 1
    with pytest.raises(PeerError, match="the transfer stopped after"):
        _collect(tmp_path, source)
    assert len(source.read_from) <= 10


def test_a_source_that_trickles_ends_the_collection(tmp_path: Path) -> None:
    class Slow(FakeSource):
        async def read(self, name: str, begin: int, end: int) -> AsyncIterator[bytes]:
            self.read_from.append(begin)
            while True:
                yield bytes(1)
                await asyncio.sleep(0.001)

    source = Slow({"surgeon.mcap": bytes(1_000_000)})
    collection = Collection(tmp_path, list[str]().append, pause_s=0, slow_s=0.02)
    with pytest.raises(PeerError, match=r"brought less than 65536 bytes in 0\.02 s"):
        asyncio.run(collection.fetch_all(source))
    assert len(source.read_from) <= 10


def test_a_source_that_lies_and_breaks_by_turns_is_not_read_for_ever(tmp_path: Path) -> None:
    class Turns(FakeSource):
        async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
            [log] = await super().offered(parts)
            return [log.model_copy(update={"sha256": _sha(b"other")})]

        async def read(self, name: str, begin: int, end: int) -> AsyncIterator[bytes]:
            self.breaks_after = end if self.breaks_after < end else 70_000
            async for block in super().read(name, begin, end):
                yield block

    source = Turns({"surgeon.mcap": bytes(100_000)})
    with pytest.raises((DataError, PeerError)):
        _collect(tmp_path, source)
    assert source.n_bytes <= 1_000_000


def test_two_sources_of_the_same_log_are_refused(tmp_path: Path) -> None:
    collection = Collection(tmp_path, list[str]().append)
    asyncio.run(collection.fetch_all(FakeSource({"netem.mcap": _LOG})))
    with pytest.raises(DataError, match=r"is a log that surgeon on .* has, too"):
        asyncio.run(collection.fetch_all(FakeSource({"netem.mcap": b"another"}, place="netem on 10.0.0.3")))
    assert _files(tmp_path) == {"netem.mcap": _LOG}


def test_an_error_of_the_source_is_the_error_of_the_collection(tmp_path: Path) -> None:
    class Gone(FakeSource):
        async def offered(self, parts: Mapping[str, int]) -> list[OfferedLog]:
            raise PeerError(Fault(self.place, "", "cannot be reached"))

    with pytest.raises(PeerError, match="cannot be reached"):
        _collect(tmp_path, Gone({}))


def test_a_full_disk_is_a_fault_and_not_a_broken_transfer(tmp_path: Path) -> None:
    tmp_path.chmod(0o755)
    (tmp_path / "surgeon.mcap.part").mkdir()
    with pytest.raises(DataError, match=r"surgeon\.mcap\.part: cannot be written"):
        _collect(tmp_path, FakeSource({"surgeon.mcap": _LOG}))


_CONTENT = bytes(range(256)) * 10_000


def test_logs_of_sides_and_of_their_restarts_are_offered_and_nothing_else(tmp_path: Path) -> None:
    logs = ["netem.mcap", "patient.mcap", "patient_2.mcap", "patient_recovered.mcap", "surgeon_13_recovered.mcap"]
    others = ["run.mcap", "scenario.yaml", "patient.mcap.part", "xpatient.mcap", "patient_2.mcap\n", "patient_a.mcap"]
    for name in [*logs, *others]:
        (tmp_path / name).write_text(name)
    (tmp_path / "surgeon.mcap").symlink_to("/etc/passwd")
    (tmp_path / "netem_2.mcap").mkdir()
    os.mkfifo(tmp_path / "netem_3.mcap")
    assert log_names(tmp_path) == logs


@pytest.mark.parametrize(
    "name", ["../secret", "/etc/passwd", "scenario.yaml", "surgeon.mcap", "netem_2.mcap", "netem_3.mcap", ""]
)
def test_no_other_file_is_opened_whatever_its_name_or_kind(tmp_path: Path, name: str) -> None:
    (tmp_path / "scenario.yaml").write_text("secret")
    (tmp_path / "surgeon.mcap").symlink_to(tmp_path / "scenario.yaml")
    (tmp_path / "netem_2.mcap").mkdir()
    os.mkfifo(tmp_path / "netem_3.mcap")  # whose other end nobody opens: it must not be waited for
    with pytest.raises(DataError), opened_log(tmp_path, name):
        pass


@pytest.mark.parametrize("n_part", [0, 1, 1 << 20, len(_CONTENT), len(_CONTENT) + 1])
def test_an_offer_has_the_digests_of_the_whole_and_of_the_part(tmp_path: Path, n_part: int) -> None:
    (tmp_path / "netem.mcap").write_bytes(_CONTENT)
    [offer] = offered_logs(tmp_path, {"netem.mcap": n_part})
    assert (offer.n_bytes, offer.sha256) == (len(_CONTENT), _sha(_CONTENT))
    assert offer.part_sha256 == (None if n_part > len(_CONTENT) else _sha(_CONTENT[:n_part]))


@pytest.mark.parametrize(("begin", "end"), [(0, 10), (5, 1_500_000), (2_560_000, 2_560_000), (2_559_999, 1 << 40)])
def test_a_range_is_these_bytes_of_the_log(tmp_path: Path, begin: int, end: int) -> None:
    (tmp_path / "netem.mcap").write_bytes(_CONTENT)
    assert b"".join(read_range(tmp_path, "netem.mcap", begin, end)) == _CONTENT[begin:end]


def test_a_folder_that_is_not_there_is_a_fault(tmp_path: Path) -> None:
    with pytest.raises(DataError, match="none: cannot be read: No such file"):
        log_names(tmp_path / "none")


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
