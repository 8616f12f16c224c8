import pytest
from hypothesis import given
from hypothesis import strategies as st

from tis.common.errors import InputError
from tis.deploy.studies.admissible.criterion import Limit, parse_limit


@pytest.mark.parametrize(
    ("text", "limit"),
    [
        ("rmse_3d_mm=2", Limit("rmse_3d_mm", True, 2.0)),
        ("rmse_3d_mm <= 2.5", Limit("rmse_3d_mm", True, 2.5)),
        ("coverage_pct=90", Limit("coverage_pct", False, 90.0)),
        ("r2_pct_x=99", Limit("r2_pct_x", False, 99.0)),
        ("coverage_pct<=99", Limit("coverage_pct", True, 99.0)),
        ("links.forward.loss_pct=1e-1", Limit("links.forward.loss_pct", True, 0.1)),
        ("hand_to_eye_p99_ms=300", Limit("sight.hand_to_eye_ms.p99", True, 300.0)),
        ("freeze_max_pct<=1", Limit("sight.freeze_pct", True, 1.0)),
        ("safety.left.time_s.tracking>=20", Limit("safety.left.time_s.tracking", False, 20.0)),
    ],
)
def test_limits_are_read(text: str, limit: Limit) -> None:
    assert parse_limit(text) == limit


def test_only_errors_are_pooled_by_their_squares() -> None:
    names = ("rmse_3d_mm", "rmse_mm_x", "accuracy.hold.rmse_3d_mm", "safety.left.estimate_rmse_3d_mm")
    others = ("accuracy.hold.nrmse_fit_3d_pct", "accuracy.hold.nrmse_fit_pct.0", "coverage_pct", "max_3d_mm")
    assert [Limit(name, True, 1.0).is_root_mean_square for name in names] == [True] * 4
    assert [Limit(name, True, 1.0).is_root_mean_square for name in others] == [False] * 4


@pytest.mark.parametrize(
    "text", ["rmse", "=2", "rmse_3d_mm=", "rmse_3d_mm=two", "rmse=nan", "rmse=inf", "rmse<2", ""]
)
def test_other_texts_are_refused_by_name(text: str) -> None:
    with pytest.raises(InputError, match="tis admissible: --limit: must"):
        parse_limit(text)


@given(st.floats(-1e6, 1e6), st.floats(-1e6, 1e6), st.booleans())
def test_the_sign_of_a_margin_tells_whether_the_limit_holds(bound: float, value: float, at_most: bool) -> None:
    limit = Limit("any", at_most, value)
    margin = limit.margin(bound)
    if abs(bound - value) > 1e-6 * max(1.0, abs(value), abs(bound)):
        assert (margin <= 0) == (bound <= value if at_most else bound >= value)
    assert limit.margin(value) == 0
    assert limit.margin(float("nan")) == float("inf")
    assert parse_limit(limit.text) == Limit("any", at_most, float(f"{value:g}"))
