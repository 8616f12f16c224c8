"""Warnings for a reader: their order, and what becomes one line."""

from tis.deploy.present.notices import notices

GAP = "1 gap, after 40.990 s (row 4099; 40 ms): played without the time that is missing"
LAYOUT = "it has no columns of PSM2: the arm's pose is the command, positions times 1"


def test_what_changed_the_score_comes_before_what_the_layout_implies() -> None:
    texts = [f"anna_01: {LAYOUT}", "trained without a.csv: other columns than the source's", f"ben_01: {GAP}"]
    assert notices(texts, 5, "f")[0] == f"ben_01: {GAP}"
    assert notices(texts, 1, "f") == [f"ben_01: {GAP}", "and 2 more, in f"]


def test_one_text_of_several_is_one_line() -> None:
    texts = [f"t{k}: {LAYOUT}" for k in range(9)]
    assert notices(texts, 5, "f") == [f"t0, t1, t2, t3, t4, t5 and 3 more: {LAYOUT}"]
    assert notices(texts[:2], 5, "f") == [f"t0, t1: {LAYOUT}"]


def test_texts_that_differ_in_numbers_name_whom_they_concern() -> None:
    other = GAP.replace("1 gap", "2 gaps").replace("40.990", "3.1")
    assert notices([f"a_01: {GAP}", f"b_02: {other}"], 5, "f") == [f"a_01: {GAP}; likewise b_02"]


def test_other_kinds_stay_as_they_are() -> None:
    texts = ["one seed: no draws", "no colon at all", "moesp_kf: 3 of 10 places", "no colon at 2"]
    assert notices(texts, 5, "f") == texts
    assert notices([], 5, "f") == []


def test_a_text_of_a_trial_that_is_scored_and_trains_others_does_not_read_as_a_model_of_its_own() -> None:
    jump = "MTML leaves its path for 1 row, at row 3"
    both = [f"cleo: {jump}", f"trained on cleo: {jump}"]
    assert notices(both, 5, "f") == [f"cleo, scored and as training data of others: {jump}"]
    several = [*both, f"trained on eve: {jump}", f"ann: {jump}"]
    assert notices(several, 5, "f") == [
        f"cleo, scored and as training data of others: {jump}",
        f"trained on eve: {jump}",
        f"ann: {jump}",
    ]
    assert notices([both[1], f"trained on eve: {jump}"], 5, "f") == [f"trained on cleo, eve: {jump}"]
    assert notices(["a_1: 2 rows", "trained on a_1: 2 rows", "b_1: 3 rows", "trained on b_1: 3 rows"], 5, "f") == [
        "a_1, scored and as training data of others: 2 rows; likewise b_1",
    ]
