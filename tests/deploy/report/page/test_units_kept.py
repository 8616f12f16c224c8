"""Numbers and units."""

from deploy.report.page.units_kept import keep_units


def test_a_number_keeps_its_unit_and_words_may_part() -> None:
    assert keep_units("lost 1.25 % of 600 messages") == "lost 1.25\u00a0% of 600 messages"
    assert keep_units("12 ms, 3 mm. 4 s") == "12\u00a0ms, 3\u00a0mm. 4\u00a0s"
    assert keep_units("5 samples, 6 mst, 7 szenes") == "5 samples, 6 mst, 7 szenes"
