"""Controller types are imported when a robot has one, and all can be."""

import subprocess
import sys

import pytest

from arm_drake.controllers.joint_state_broadcaster import (
    JointStateBroadcaster,
    JointStateBroadcasterParameters,
)
from arm_drake.controllers.registry import (
    STANDARD_TYPES,
    ControllerType,
    ControllerTypes,
    check_controller_type,
    load_type,
)

BROADCASTER = "joint_state_broadcaster:JointStateBroadcaster"


@pytest.mark.parametrize("name", STANDARD_TYPES)
def test_all_of_ours_can_be_imported(name: str) -> None:
    row = load_type(name, STANDARD_TYPES[name])

    assert check_controller_type(row, "") == row
    assert row.system is not None


def test_a_type_is_the_same_whenever_it_is_asked_for() -> None:
    types = ControllerTypes({"broadcaster": BROADCASTER})

    first = types["broadcaster"]

    assert first == (JointStateBroadcasterParameters, JointStateBroadcaster, "", "", ())
    assert types["broadcaster"] is first


def test_a_system_is_called_as_its_type_unless_the_row_says_so() -> None:
    row = load_type("a_package/JointStateBroadcaster", "joint_state_broadcaster")

    assert row == load_type("other", BROADCASTER)
    assert row == ControllerType(JointStateBroadcasterParameters, JointStateBroadcaster)


def test_types_are_added_and_removed_as_in_a_dictionary() -> None:
    types = ControllerTypes({"broadcaster": BROADCASTER})
    own = ControllerType(JointStateBroadcasterParameters)

    types["own"] = own
    del types["broadcaster"]

    assert dict(types) == {"own": own}
    assert "broadcaster" not in types
    assert len(types) == 1


@pytest.mark.slow
def test_the_tables_are_read_without_importing_what_is_in_them() -> None:
    program = """
import sys
from arm_drake.controllers import CONTROLLER_TYPES
assert "pid_controller/PidController" in CONTROLLER_TYPES and len(CONTROLLER_TYPES) > 30
print(*(name for name in sys.modules if name.endswith("_controller")), sep=", ")
CONTROLLER_TYPES["pid_controller/PidController"]
print(*(name for name in sys.modules if name.endswith("pid_controller")), sep=", ")
"""

    done = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        timeout=120,
        check=True,
    )

    assert done.stdout == "\narm_drake.controllers.pid_controller\n"
