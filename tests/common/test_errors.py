import pytest

from tis.common.errors import DataError, Fault, InputError, PeerError, TisError


def test_a_fault_reads_where_field_rule_got() -> None:
    fault = Fault("s.yaml", "network.forward.delay.delay_ms", "must be at least 0", -1)
    assert str(fault) == "s.yaml: network.forward.delay.delay_ms: must be at least 0 (got -1)"


def test_parts_that_are_empty_leave_no_colon() -> None:
    assert str(Fault("s.yaml", "", "must be a mapping", [1])) == "s.yaml: must be a mapping (got [1])"
    assert str(Fault("", "", "no")) == "no"


def test_none_is_a_value_and_no_value_is_none() -> None:
    assert str(Fault("a", "b", "must be text", None)) == "a: b: must be text (got None)"
    assert str(Fault("a", "b", "is required")) == "a: b: is required"


def test_a_long_value_is_cut_and_stays_on_one_line() -> None:
    text = str(Fault("a", "b", "no", "line\n" * 1000))
    assert len(text) < 120
    assert text.endswith("...)")
    assert "\n" not in text


def test_an_error_shows_all_its_faults() -> None:
    faults = [Fault("a", "b", "no"), Fault("a", "c", "neither", 1)]
    error = InputError(faults)
    assert str(error) == "a: b: no\na: c: neither (got 1)"
    assert error.faults == tuple(faults)
    assert InputError(faults[0]).faults == (faults[0],)


@pytest.mark.parametrize(("kind", "code"), [(InputError, 2), (PeerError, 3), (DataError, 4), (TisError, 70)])
def test_exit_codes(kind: type[TisError], code: int) -> None:
    assert kind(Fault("a", "b", "no")).exit_code == code
