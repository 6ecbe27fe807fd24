"""Cases that the upstream C++ code computed, as conformance tests replay them.

The folder is the environment variable ARM_DRAKE_ORACLE. Without it, and where there is
no folder of all cases beside the project either, a subset in `tests/data` is replayed.
"""

import gzip
import json
import lzma
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

_ALL = Path(__file__).parents[2] / "shared" / "oracle"
SUBSET = Path(__file__).parent / "data" / "oracle"


def oracle_folder() -> Path:
    """Return the folder of the cases."""
    requested = os.environ.get("ARM_DRAKE_ORACLE")
    if requested:
        return Path(requested)
    return _ALL if _ALL.is_dir() else SUBSET


def oracle_cases(name: str) -> Any:
    """Return the cases of the file `<name>.json`, which may be packed (.gz, .xz).

    The module's tests are skipped if there is no such file in the folder. Without the
    folder they fail if ARM_DRAKE_NO_SKIP is 1.
    """
    folder = oracle_folder()
    for suffix, unpack in (
        ("", bytes),
        (".gz", gzip.decompress),
        (".xz", lzma.decompress),
    ):
        file = folder / f"{name}.json{suffix}"
        if file.exists():
            return json.loads(unpack(file.read_bytes()))
    reason = f"no reference cases {name!r}; ARM_DRAKE_ORACLE names their folder"
    # Whoever names a folder of some of the files means these.
    if not folder.is_dir() and os.environ.get("ARM_DRAKE_NO_SKIP") == "1":
        pytest.fail(reason)
    pytest.skip(reason, allow_module_level=True)


def number(x: float | str) -> float:
    """Return a number of a case, where "nan", "inf" and "-inf" are strings."""
    return float(x)


def assert_close(actual: Any, expected: Any, what: str = "") -> None:
    """Fail unless numbers are upstream's; NaN equals NaN."""
    expected = np.array(expected, dtype=float)
    found = np.asarray(actual)
    # What `assert_allclose` says takes a hundred times as long as to see that it is so.
    if found.shape == expected.shape and found.dtype.kind in "fi":
        with np.errstate(invalid="ignore"):  # Infinite numbers.
            off = np.abs(found - expected) - 1e-9 * np.abs(expected)
        if (off <= 1e-12).all():
            return
    np.testing.assert_allclose(actual, expected, rtol=1e-9, atol=1e-12, err_msg=what)
