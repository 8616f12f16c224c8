"""The page and the files, from figures written by hand."""

import csv
import io
import json

import pytest

from tests.deploy.studies.methods.made_up import figures, hold, report
from tests.markdown_tables import ragged_rows
from tis.common.extras import GET_REPORT
from tis.deploy.studies.methods import page as files_module
from tis.deploy.studies.methods.claims import CLAIMS
from tis.deploy.studies.methods.page import NAMES, csv_of, detail_tables, files_of, main_table, page_text


def test_each_adjective_stands_beside_a_measured_cell() -> None:
    table = main_table([hold(), figures("moesp_kf")])
    assert table.columns[-2:] == ["hold", "moesp_kf"]
    by_title = {row[0]: row for row in table.texts()}
    assert list(by_title) == [claim.title for claim in CLAIMS.values()]
    assert {title: row[-1] for title, row in by_title.items()} == {
        "Computational Complexity": "training: rows^1.00, size^2.00, step: rows^0.00, size^0.50",
        "Real-Time Performance": "5.00 µs, p99 8.00; up to 120 kHz",
        "Handling Packet Loss": "30 % in bursts: error ×1.40, 0.600 of hold's",
        "Adaptability": "error ×1.30 (Knot_Tying)",
        "Data Requirements": "2 trials are enough",
        "Scalability": "both hands up to 60 kHz, step: size^0.50",
        "Robustness to Noise": "5 mm: error ×4.00, 1.500 of hold's; trained with it 0.700",
        "Training Time": "9.00 s",
        "Reliability": "p99 4.00 mm, 0 % missing, 94.0 % in 95 % regions",
        "Real-World Applications": "0.400 / 0.800",
    }
    assert by_title["Handling Packet Loss"][1:4] == ["Robust", "Moderate", "Sensitive"]
    assert by_title["Training Time"][-2] == "-"


def test_a_setting_that_a_method_lacks_is_a_dash_and_a_measure_no_row() -> None:
    fewer = figures("moesp_kf", accuracy=figures("moesp_kf")["accuracy"][:1])
    table = detail_tables([figures("drmf"), fewer])["Ratio to hold by delay"]
    assert table.columns == ["method", "100 ms", "500 ms"]
    assert list(table.texts()) == [
        ["drmf", "0.400 (0.350-0.450)", "0.800 (0.700-0.900)"],
        ["moesp_kf", "0.400 (0.350-0.450)", "-"],
    ]
    assert detail_tables([hold()])["Ratio to hold by number of training trials"].rows == []


def test_the_page_has_even_tables_says_where_it_is_from_and_what_is_missing() -> None:
    lacking = figures(
        "cnn", gaps=["needs jax: pip install"], accuracy=[], loss=[], noise=[], reliability=None, step=None
    )
    text = page_text(report(hold(), figures("moesp_kf"), lacking, absent=["gpr"]))
    assert ragged_rows(text) == []
    assert "```\ntis paper --methods --seed 7\n```" in text
    assert "JIGSAWS: 2 trials of Suturing by 2 people (C, D), and 1 of Knot_Tying" in text
    assert "- `cnn`: needs jax: pip install\n- not among the methods: `gpr`" in text
    assert "--quick" not in text
    assert "### Reliability" in text
    assert "**Training Time**: The paper: *Minimal*. All training trials take `moesp_kf` 9.00 s" in text
    assert "made with `--quick`" in page_text(report(hold(), figures("moesp_kf"), quick=True))


def test_figures_stand_above_their_tables_if_there_are_any() -> None:
    told = report(hold(), figures("moesp_kf"))
    text = page_text(told, "methods_figures")
    assert text.count("](methods_figures/") == 4
    at = text.index("](methods_figures/accuracy.svg)")
    assert text.index("### Ratio to hold by delay") < at < text.index("| hold | 1.000 (1.000-1.000)")
    assert "![" not in page_text(told)


def test_without_matplotlib_there_are_no_figures_and_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(files_module, "find_spec", lambda _: None)
    files = files_of(report(hold(), figures("moesp_kf")))
    assert sorted(files.contents) == ["methods.csv", "methods.json", "methods.tex"]
    assert files.left_out == (f"no figures without matplotlib: {GET_REPORT}",)


def test_a_synthetic_population_is_named_as_such() -> None:
    there = {**report()["trials"], "synthetic": True, "elsewhere": {}}
    text = page_text(report(hold(), figures("moesp_kf"), trials=there))
    assert "a synthetic population, as no recordings were there" in text
    assert "there are no trials of another task" in text


def test_all_numbers_are_in_the_csv_once_with_their_setting() -> None:
    rows = list(csv.DictReader(io.StringIO(csv_of(report(figures("moesp_kf"))))))
    found = {(row["measure"], row["at"], row["figure"]): row["value"] for row in rows}
    assert len(found) == len(rows)
    assert found["loss", "loss_pct=30.0 bursts=True", "growth.ratio"] == "1.4"
    assert found["data", "n_trials=2", "train_s"] == "2.0"
    assert found["accuracy", "delay_ms=500.0", "r2_pct.2"] == "95.0"
    assert found["exponents", "", "train_rows.high"] == "1.1"
    assert found["training_s", "", "training_s"] == "9.0"
    assert ("accuracy", "delay_ms=500.0", "r2_pct.1") not in found  # None


def test_the_files_are_the_report_the_table_for_latex_and_figures() -> None:
    files = files_of(report(hold(), figures("moesp_kf")))
    assert sorted(files.contents) == sorted(NAMES)
    assert files.left_out == ()
    content = files.contents["methods.json"]
    assert json.loads(content)["methods"][1]["enough_trials"] == "2"
    latex = str(files.contents["methods.tex"])
    assert latex.startswith("% tis paper --methods --seed 7\n\\begin{tabular}{llllrr}\n")
    assert r"5.00 $\mu$s, p99 8.00" in latex
    assert bytes(files.contents["accuracy.pdf"]).startswith(b"%PDF")  # type: ignore[arg-type]
    assert b"moesp_kf" in bytes(files.contents["training.svg"])  # type: ignore[arg-type]
