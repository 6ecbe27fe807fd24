"""The programs of docs/planning.md run."""

from pathlib import Path

import pytest

from tests.snippets import read_blocks

PAGE = Path(__file__).parents[2] / "docs" / "planning.md"


@pytest.mark.slow
def test_the_programs_of_the_page_run() -> None:
    names: dict = {}

    for block in read_blocks(PAGE):
        if block.language == "python":
            exec(compile(block.text, str(PAGE), "exec"), names)  # noqa: S102

    assert names["solution"].position_error < 1e-5
    # As far as the plan says, the robot gets.
    rollout, plan = names["rollout"], names["plan"]
    last = dict(zip(rollout.joint_names, rollout.position[-1], strict=True))
    assert last == pytest.approx(plan.end, abs=5e-3)
