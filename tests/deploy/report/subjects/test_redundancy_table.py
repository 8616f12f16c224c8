"""What redundancy cost and gained, as a table of the page."""

from typing import Any

from tests.deploy.report.outline import Outline
from tests.deploy.report.partial import part
from tis.deploy.present.page import nonbreaking_units
from tis.deploy.report.subjects.redundancy import Redundancy, redundancy_table

FOUND: dict[str, Any] = {
    "copies": 2,
    "copy_spacing_ms": 0.0,
    "history": 1,
    "price": {"packets_per_s": 240.0, "bytes_per_s": 64e3, "packets_per_s_once": 120.0, "bytes_per_s_once": 16e3},
    "lost": {"packets_pct": 1.06, "samples_pct": 0.0, "samples_once_pct": None},
    "age_ms": {"mean": 66.6, "p95": 102.0},
    "age_once_ms": {"mean": 86.2, "p95": 135.3},
}


def test_price_and_gain_stand_beside_those_of_the_first_packets() -> None:
    page = Outline(redundancy_table(part(Redundancy, FOUND)).html())
    rows = [text for _, text in page.all("tr")]
    assert rows == [
        "figureas sentfirst packets alone",
        "packets/s240.0120.0",
        "kB/s64.0016.00",
        "packets that never arrived, %1.06-",
        "samples that never arrived, %0-",
        "age at the ticks, mean, ms66.6086.20",
        "age at the ticks, p95, ms102.0135.3",
    ]
    (caption,) = [text for _, text in page.all("caption")]
    assert caption == "What redundancy cost and gained: each sample 2 times, all at once, with the sample before it"


def test_who_sends_once_has_no_table() -> None:
    assert not redundancy_table(part(Redundancy, FOUND | {"copies": 1, "history": 0})).rows


def test_a_number_keeps_its_unit_and_words_may_part() -> None:
    assert nonbreaking_units("lost 1.25 % of 600 messages") == "lost 1.25\u00a0% of 600 messages"
    assert nonbreaking_units("12 ms, 3 mm. 4 s") == "12\u00a0ms, 3\u00a0mm. 4\u00a0s"
    assert nonbreaking_units("5 samples, 6 mst, 7 szenes") == "5 samples, 6 mst, 7 szenes"
