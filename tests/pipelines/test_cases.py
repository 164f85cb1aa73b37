"""The form of all pipelines: figures are stored case by case, and tables are made of them."""

import json
import sys

import cases
import pages
import pytest

import pdsurrogate as pds


def measure(name: str, length: float):
    if length > 2:
        raise pds.SimulationFailed("too long", None)
    yield name, length, [1.0, 2.0], None


STUDY = cases.of_rows(
    "bars",
    measure,
    [("one", 1.0), ("two", 2.0), ("long", 3.0)],
    head=["bar", "length: .1f", "ends: g", "-"],
)
TABLE = """| bar | length | ends | - |
| --- | ---: | ---: | ---: |
| one | 1.0 | 1 / 2 | - |
| two | 2.0 | 1 / 2 | - |"""


@pytest.fixture
def told(tmp_path, monkeypatch, capsys):
    """Runs the script with words, and returns what it prints."""
    monkeypatch.setattr(cases, "FIGURES", tmp_path)
    monkeypatch.setattr(pages, "DOCS", tmp_path)
    (tmp_path / "page.md").write_text("Bars:\n\n<!-- bars -->\n<!-- /bars -->\n")

    def run(*words: str) -> str:
        monkeypatch.setattr(sys, "argv", ["bars.py", *words])
        cases.report("Bars.", STUDY)
        return capsys.readouterr().out

    return run


def test_cases_are_measured_one_by_one_and_stored(told, tmp_path):
    assert "bars: two, 2.0: [['two', 2.0, [1.0, 2.0], None]]" in told("two 2.0")
    assert list(cases.stored("bars")) == ["two, 2.0"]
    out = told("--lacking", "--docs")
    assert "bars: two" not in out
    assert "bars: long, 3.0: too long" in out
    assert list(cases.stored("bars")) == ["one, 1.0", "two, 2.0"]
    assert TABLE in (tmp_path / "page.md").read_text()
    assert told("--docs") == ""


def test_cases_that_are_added_meanwhile_stay_and_those_of_before_go(told, tmp_path):
    """A process dropped what others had stored since it began."""
    path = tmp_path / "bars.json"
    path.write_text('{"old": [["old", 0.0]], "one, 1.0": [["one", 1.0]]}')

    def and_another(name, length):
        path.write_text(json.dumps(cases.stored("bars") | {"new": [["new", 9.0]]}))
        return measure(name, length)

    study = cases.of_rows("bars", and_another, [("two", 2.0)], head=["bar", "length"])
    study.cases["one, 1.0"] = STUDY.cases["one, 1.0"]
    cases.measure(study, "two, 2.0", dropped={"old"})
    assert list(cases.stored("bars")) == ["two, 2.0", "one, 1.0", "new"]
    assert cases.of_rows("bars", measure, ["one"], head=["bar"]).cases.keys() == {"one"}


def test_errors_at_several_spacings_are_a_row():
    case = cases.Case(lambda spacing: [("force", spacing, 7)], (0.1, 0.05))
    study = cases.at_spacings("errors", {"bar": case})
    found = {name: list(run()) for name, run in study.cases.items()}
    del found["bar, spacing 0.05"]
    text = study.tables["errors"](found)
    assert "| bar | force | 0.1 / 0.05 | +0.10 / - | 7 / - |" in text


def test_figures_are_rounded_and_lists_joined():
    assert cases.rounded({"a": [1 / 3, 2]}) == {"a": [0.333333, 2]}
    assert cases.shown([0.5, None, "none"], ".2f") == "0.50 / - / none"
    assert [cases.error_in_words(error) for error in (0.5, 1e-4, 0.0)] == [
        "+0.50",
        "+1e-04",
        "+0.00",
    ]
