"""Cases that the upstream C++ code computed, as conformance tests replay them."""

import gzip
import json
import os
from pathlib import Path
from typing import Any

import pytest

_DEFAULT = Path(__file__).parents[2] / "shared" / "oracle"


def oracle_cases(name: str) -> list[dict[str, Any]]:
    """Return the cases of the file `<name>.json` or `<name>.json.gz`.

    The folder is the environment variable ARM_DRAKE_ORACLE. Without it the module's
    tests are skipped, or fail if ARM_DRAKE_NO_SKIP is 1.
    """
    folder = Path(os.environ.get("ARM_DRAKE_ORACLE", _DEFAULT))
    if not folder.is_dir():
        reason = "no folder of reference cases; set ARM_DRAKE_ORACLE"
        if os.environ.get("ARM_DRAKE_NO_SKIP") == "1":
            pytest.fail(reason)
        pytest.skip(reason, allow_module_level=True)
    packed = folder / f"{name}.json.gz"
    if packed.exists():
        return json.loads(gzip.decompress(packed.read_bytes()))
    return json.loads((folder / f"{name}.json").read_text())


def number(x: float | str) -> float:
    """Return a number of a case, where "nan", "inf" and "-inf" are strings."""
    return float(x)
