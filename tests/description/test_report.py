"""The load report: one line for each thing, once."""

import json

from arm_drake.description.report import LoadReport, ReportEntry


def make_report() -> LoadReport:
    report = LoadReport()
    report.add(
        "error", "missing", "no mesh", "left out", where="link 'a'", file="r", line=3
    )
    report.add("info", "ignored", "a tag", "no effect")
    return report


def test_an_entry_reads_as_one_line():
    assert str(make_report()) == (
        "error: r:3: link 'a': no mesh; left out\ninfo: a tag; no effect"
    )


def test_the_same_thing_is_reported_once():
    report = make_report()

    report.add("info", "ignored", "a tag", "no effect")

    assert len(report) == 2


def test_entries_are_iterated_in_order():
    assert [entry.what for entry in make_report()] == ["no mesh", "a tag"]


def test_errors_are_those_of_severity_error():
    expected = ReportEntry(
        "error", "missing", "no mesh", "left out", "link 'a'", "r", 3
    )

    assert make_report().errors == (expected,)


def test_json_has_every_field():
    assert make_report().to_json()[0] == {
        "severity": "error",
        "kind": "missing",
        "what": "no mesh",
        "done": "left out",
        "where": "link 'a'",
        "file": "r",
        "line": 3,
    }


def test_the_representation_is_json():
    report = make_report()

    text = repr(report).removeprefix("LoadReport(").removesuffix(")")

    assert json.loads(text) == report.to_json()
