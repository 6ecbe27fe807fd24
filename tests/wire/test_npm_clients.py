"""rosbridge and Foxglove as clients from npm see them."""

import base64
from pathlib import Path
from typing import Any

import pytest

from arm_drake.description.entry import bundled_robots
from arm_drake.wire.foxglove import find_asset
from tests.wire.served import JTC, port_of, run_node, served, simulation

pytestmark = pytest.mark.slow

MESH = "package://doosan_a0912/meshes/base_0.dae"


@pytest.fixture(scope="module")
def roslib() -> dict[str, Any]:
    with served(simulation()) as server:
        found: dict[str, Any] = run_node("roslib_client.mjs", port_of(server))
    return found


def test_roslib_gets_cbor_as_often_as_it_is_published(roslib: dict[str, Any]) -> None:
    counts = roslib["counts"]
    # By the simulated time of what came: 100 Hz; a busy machine may lose some.
    assert counts["simulated"] >= 0.9
    assert 0.8 <= counts["states"] / (100.0 * counts["simulated"] + 1.0) <= 1.01
    # At most one every 0.1 s of the wall clock, as was asked for.
    assert 3 <= counts["frames"] <= 10.0 * counts["waited"] + 2.0
    assert len(roslib["description"]) == 1


def test_roslib_follows_and_cancels_goals(roslib: dict[str, Any]) -> None:
    reached, cancelled = roslib["reached"], roslib["cancelled"]

    assert reached["how"] == "result"
    assert '"error_code":0' in reached["result"]
    assert reached["feedback"] >= 10
    # That is how roslib reports it.
    assert cancelled["how"] == "failed"
    assert "canceled" in cancelled["result"]


def test_roslib_publishes_and_calls(roslib: dict[str, Any]) -> None:
    assert roslib["state"]["position"] == pytest.approx([-0.1] * 6, abs=1e-3)
    assert ["joint_trajectory_controller", "active"] in roslib["controllers"]
    assert roslib["missing"].startswith("no service '/no/such'")
    assert "/joint_states" in roslib["topics"]


@pytest.fixture(scope="module")
def foxglove() -> dict[str, Any]:
    with served(simulation(), "foxglove:0") as server:
        port = port_of(server, "foxglove")
        found: dict[str, Any] = run_node("foxglove_client.mjs", port, MESH)
    return found


def test_foxglove_decodes_all_channels_by_their_schemas(
    foxglove: dict[str, Any],
) -> None:
    names, counts = foxglove["channels"], foxglove["counts"]

    assert names["/joint_states"] == ["sensor_msgs/msg/JointState", "cdr", "ros2msg"]
    # Lines of the log are told when there are any.
    assert set(counts) | {"/rosout"} == set(names)
    assert counts["/joint_states"] > 20
    assert foxglove["description"] == [foxglove["description"][0]]
    assert foxglove["state"]["name"] == [f"joint{index}" for index in range(1, 7)]


def test_foxglove_publishes(foxglove: dict[str, Any]) -> None:
    assert foxglove["state"]["position"] == pytest.approx([0.1] * 6, abs=1e-3)
    assert any("no JSON" in text for text in foxglove["status"])


def test_foxglove_calls_services(foxglove: dict[str, Any]) -> None:
    states = {row["name"]: row["state"] for row in foxglove["listed"]["controller"]}

    assert states["joint_trajectory_controller"] == "active"
    assert "stay loaded" in foxglove["refused"]["failure"]


def test_foxglove_reads_and_sets_parameters(foxglove: dict[str, Any]) -> None:
    name = f"{JTC}.constraints.goal_time"

    assert foxglove["before"][name] == 0
    assert foxglove["before"][f"{JTC}.joints"][0] == "joint1"
    assert foxglove["after"][name] == 2.5


def test_foxglove_gets_meshes_of_the_robots_packages_and_no_other_file(
    foxglove: dict[str, Any],
) -> None:
    mesh, *others = foxglove["assets"]
    folder = bundled_robots()["doosan_a0912"].parents[1]

    assert base64.b64decode(mesh) == (folder / "meshes/base_0.dae").read_bytes()
    assert others == [None, None]


def test_assets_lie_in_their_package(tmp_path: Path) -> None:
    package = tmp_path / "robot"
    package.mkdir()
    (package / "a.stl").write_bytes(b"mesh")
    (tmp_path / "secret").write_bytes(b"secret")
    (package / "link").symlink_to(tmp_path / "secret")
    folders = {"robot": [package]}

    assert find_asset("package://robot/a.stl", folders) == package / "a.stl"
    for uri in (
        "package://robot/../secret",
        "package://robot/link",
        "package://robot//etc/passwd",
        "package://other/a.stl",
        "file:///etc/passwd",
        "a.stl",
    ):
        assert find_asset(uri, folders) is None
