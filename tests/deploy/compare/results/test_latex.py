from tests.deploy.compare.results.test_grid_tables import made_up
from tis.deploy.compare.results.tables import latex
from tis.deploy.present.table import Table


def test_a_grid_is_a_tabular_with_its_command_above() -> None:
    text = latex(made_up(2) | {"command": "tis compare\n  s"})
    lines = text.splitlines()
    assert lines[0] == "% tis compare s"
    assert lines[2] == r"\begin{tabular}{llrr}"
    assert lines[4] == r"delay\_ms & p\_loss & hold & mine \\"
    assert lines[9] == r"10 & 0.1 & 1.000 & 0.110 \\"
    assert lines[-1] == r"\end{tabular}"


def test_what_latex_reads_as_a_command_is_text() -> None:
    report = made_up(1) | {"command": "c", "axes": ["a"]}
    for row in report["rows"]:
        row["estimator"] = {"hold": "hold", "mine": r"a_b%c\d^~#"}[row["estimator"]]
    assert r"a\_b\%c\textbackslash{}d\textasciicircum{}\textasciitilde{}\#" in latex(report)


def test_signs_of_figures_are_written_as_latex_has_them() -> None:
    text = Table("", ["method", "R²"], [["hold", "×2.5, 3 µs"]]).latex("c")
    assert text.splitlines()[3] == r"method & R$^2$ \\"
    assert text.splitlines()[5] == r"hold & $\times$2.5, 3 $\mu$s \\"
