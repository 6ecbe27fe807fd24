"""Poses and Jacobians of a robot's links, against Pinocchio's."""

import numpy as np
import pinocchio as pin
import pytest

import arm_drake as ad
from arm_drake.plant.kinematics import PlantKinematics
from tests import models

# Of a chain of some rotations, in two libraries.
ROUNDING = 1e-12


class Pinocchio:
    """The same of another library; joints by name, others at their initial ones."""

    def __init__(
        self, urdf: str, initial: dict[str, float], joints: tuple[str, ...], base: str
    ) -> None:
        self.model = pin.buildModelFromXML(urdf)
        self.data = self.model.createData()
        self.q = pin.neutral(self.model)
        for name, position in initial.items():
            self.q[self._at(name)] = position
        self.joints, self.base = joints, base

    def _at(self, joint: str) -> int:
        return self.model.idx_qs[self.model.getJointId(joint)]

    def pose_and_jacobian(
        self, positions: np.ndarray, link: str
    ) -> tuple[np.ndarray, np.ndarray]:
        q = self.q.copy()
        for joint, position in zip(self.joints, positions, strict=True):
            q[self._at(joint)] = position
        frames = [self.model.getFrameId(name) for name in (self.base, link)]
        pin.computeJointJacobians(self.model, self.data, q)
        pin.updateFramePlacements(self.model, self.data)
        base, tip = (self.data.oMf[frame] for frame in frames)
        J = pin.getFrameJacobian(
            self.model, self.data, frames[1], pin.LOCAL_WORLD_ALIGNED
        )
        v_at = [self.model.idx_vs[self.model.getJointId(j)] for j in self.joints]
        R = np.kron(np.eye(2), base.rotation.T)
        return (base.inverse() * tip).homogeneous, (R @ J)[:, v_at]


@pytest.mark.slow
def test_poses_and_jacobians_are_pinocchios() -> None:
    robot = ad.load_robot("doosan_a0912")
    description, initial = robot.description, dict(robot.initial_positions)
    # In another order than that of the chain.
    joints = tuple(joint.name for joint in description.movable_joints)[::-1]
    base, *_, tip = description.links
    ours = PlantKinematics(description, initial, joints, base)
    theirs = Pinocchio(description.urdf, initial, joints, base)
    random = np.random.default_rng(7)

    for _ in range(5):
        q = random.uniform(-2.0, 2.0, len(joints))
        for link in description.links:
            pose, J = theirs.pose_and_jacobian(q, link)
            assert ours.pose(q, link) == pytest.approx(pose, abs=ROUNDING)
            assert ours.jacobian(q, link) == pytest.approx(J, abs=ROUNDING)
    assert set(ours.joints_to(tip)) == set(joints)


def test_a_base_may_lie_within_the_chain(tmp_path) -> None:
    robot = models.load(
        tmp_path,
        models.PARTLY_COMMANDED,
        initial_positions={"first": 0.3, "second": 0.5},
    )
    initial = dict(robot.initial_positions)
    # The base is turned against the world, and a joint that isn't asked for is bent.
    joints, base = ("third",), "one"
    ours = PlantKinematics(robot.description, initial, joints, base)
    theirs = Pinocchio(robot.description.urdf, initial, joints, base)

    for angle in (-1.0, 0.3):
        pose, J = theirs.pose_and_jacobian(np.array([angle]), "three")
        assert ours.pose(np.array([angle]), "three") == pytest.approx(pose)
        assert ours.jacobian(np.array([angle]), "three") == pytest.approx(J)
    assert ours.pose(np.array([0.0]), "two")[0, 0] == pytest.approx(np.cos(0.5))


@pytest.mark.parametrize(
    ("base", "link", "expected"),
    [
        ("base", "three", ("first", "second", "third")),
        ("three", "base", ("third", "second", "first")),
        ("one", "two", ("second",)),
        ("two", "two", ()),
    ],
)
def test_the_joints_between_two_links_are_those_of_the_way(
    tmp_path, base, link, expected
) -> None:
    robot = models.load(tmp_path, models.PARTLY_COMMANDED)
    ours = PlantKinematics(
        robot.description, robot.initial_positions, ("first", "third"), base
    )

    assert ours.joints_to(link) == expected


def test_a_joint_that_follows_another_stays_where_it_started(tmp_path) -> None:
    robot = models.load(tmp_path, models.GRIPPER)
    ours = PlantKinematics(
        robot.description, robot.initial_positions, ("finger",), "base"
    )

    poses = [ours.pose(np.array([angle]), "right") for angle in (0.0, 1.0)]

    # Of the finger at 0 the follower stands at 0.1.
    assert poses[0] == pytest.approx(poses[1], abs=0.0)
    assert poses[0][0, 0] == pytest.approx(np.cos(0.1), abs=ROUNDING)
    assert ours.jacobian(np.array([1.0]), "right") == pytest.approx(np.zeros((6, 1)))


def test_a_link_called_world_is_the_world(tmp_path) -> None:
    urdf = models.LIFT.replace('<link name="base"/>', '<link name="world"/>').replace(
        'parent link="base"', 'parent link="world"'
    )
    robot = models.load(tmp_path, urdf)
    ours = PlantKinematics(
        robot.description, robot.initial_positions, ("slide",), "world"
    )

    assert ours.pose(np.array([0.25]), "load")[:3, 3].tolist() == [0.0, 0.0, 0.25]
    assert ours.jacobian(np.array([0.25]), "load")[:, 0].tolist() == [0, 0, 1, 0, 0, 0]
