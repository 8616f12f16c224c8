"""A literal summary; its figures are held against those of sums in tests/deploy/studies/admissible/test_figures."""

from tis.deploy.compare.cells.scores import flat


def test_numbers_of_a_summary_have_dotted_paths() -> None:
    tree = {"a": {"b": [1, 2.5], "c": None, "d": "text"}, "valid": True}
    assert flat(tree) == {"a.b.0": 1.0, "a.b.1": 2.5, "a.c": None, "valid": 1.0}
