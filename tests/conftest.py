"""What holds for all tests."""

from pathlib import Path

import pytest

_HERE = Path(__file__).parent

# Replays of reference data and of whole motions: not for every few minutes.
_SLOW = ("conformance", "physics", "rollouts")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    for item in items:
        if item.path.relative_to(_HERE).parts[0] in _SLOW:
            item.add_marker(pytest.mark.slow)
