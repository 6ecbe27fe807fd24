"""The load report: one line for each thing, once."""

from pathlib import Path

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
    report.add("info", "ignored", "a tag", "no effect", line=0)

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


def test_the_representation_is_a_count():
    assert repr(make_report()) == "<LoadReport, 1 error, 1 info>"
    assert repr(LoadReport()) == "<LoadReport, nothing to report>"


def test_an_empty_report_says_so():
    assert str(LoadReport()) == "nothing to report"


def test_what_is_found_in_several_places_is_one_line():
    report = LoadReport()
    for name in "abcdef":
        report.add(
            "warning", "repair", "no mass", "1 g", where=f"link '{name}'", line=1
        )
    report.add("warning", "repair", "no mass", "2 g", where="link 'g'")

    assert str(report) == (
        "warning: link 'a', link 'b', link 'c', link 'd' and 2 more: no mass; 1 g\n"
        "warning: link 'g': no mass; 2 g"
    )
    assert len(report) == 7


def test_errors_are_read_first_and_infos_last():
    report = LoadReport()
    for severity in ("info", "warning", "error"):
        report.add(severity, "invalid", severity, "done")

    assert [line.partition(":")[0] for line in str(report).splitlines()] == [
        "error",
        "warning",
        "info",
    ]


def test_lines_are_added_where_they_are_known():
    report = LoadReport()
    report.add("info", "repair", "a", "b", where="link 'x'", file="entry")
    report.add("info", "repair", "a", "b", where="link 'y'", file="entry")
    report.add("info", "repair", "a", "b", where="link 'x'", file="other", line=3)
    report.add("info", "repair", "a", "b", file="entry")

    report.add_lines({"link 'x'": (Path("part"), 7)}.get)

    assert [(entry.file, entry.line) for entry in report] == [
        ("part", 7),
        ("entry", None),
        ("other", 3),
        ("entry", None),
    ]


def test_many_that_differ_in_numbers_only_are_one_line():
    report = LoadReport()
    for number, name in enumerate("abcde"):
        what, where = f"{name!r} is {number}.5", f"ros2_control 'h', joint '{name}'"
        report.add(
            "warning", "invalid", f"min: got '{number}.5'", "left out", where=where
        )
        report.add("warning", "invalid", what, "left out", where=where)

    first, *others = str(report).splitlines()

    assert first == (
        "warning: ros2_control 'h', joint 'a', joint 'b', joint 'c', joint 'd' and 1 "
        "more: min: got '0.5'; left out (so the first of 5; the others have other "
        "numbers)"
    )
    assert others[4] == ("warning: ros2_control 'h', joint 'e': 'e' is 4.5; left out")


def test_a_few_that_differ_in_numbers_keep_them():
    report = LoadReport()
    for number, name in enumerate("abc"):
        report.add("warning", "missing", "no mass", f"{number} kg", where=name)

    assert str(report).splitlines() == [
        f"warning: {name}: no mass; {number} kg" for number, name in enumerate("abc")
    ]
