from pathlib import Path

import pytest

from tests.conformance.oracle_files import read_files


def test_a_file_that_is_missing_does_not_keep_others_from_being_read(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("ARM_DRAKE_ORACLE", str(tmp_path))
    (tmp_path / "there.json").write_text("[1]")

    assert read_files(("missing", "there")) == {"there": [1]}
