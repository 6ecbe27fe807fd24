"""Real robots have the poses and the dynamics that Pinocchio finds for them.

Pinocchio reads a URDF that `xacro` expanded on its own, with a stand-in for the package
index of ROS, so nothing of what reads and mends descriptions here is shared.
"""

import copy
import dataclasses as dc
import functools
import logging
import os
import re
import subprocess
import sys
import xml.etree.ElementTree as ET
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pinocchio
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

import arm_drake as ad
from arm_drake.description.inertia import repair_inertials
from arm_drake.description.report import LoadReport
from arm_drake.description.urdf import write_urdf
from tests.robots import (
    load_real_robot,
    read_index,
    real_robot,
    robot_names,
    robots_folder,
)

# What INDEX.yaml says of a robot whose inertias can't be simulated as written.
UNPHYSICAL = {
    "massless moving links",
    "inertia not positive definite",
    "inertia triangle violation",
}

CONFIGURATIONS = 20

# Position [m], and each number of the rotation matrix.
POSE_TOLERANCE = 1e-9

DYNAMICS_TOLERANCE = 1e-8  # Relative.

# Found by xacro on PYTHONPATH, in place of ROS.
PACKAGE_INDEX = """
import os

def get_package_share_directory(name):
    for line in os.environ["PACKAGES"].splitlines():
        if os.path.basename(line) == name:
            return line
    raise LookupError(name)
"""


def expand(entry: dict, folder: Path) -> str:
    """Return a robot's URDF, from the command line of xacro."""
    package = folder / "ament_index_python"
    package.mkdir()
    (package / "packages.py").write_text(PACKAGE_INDEX)
    (package / "__init__.py").touch()
    file = real_robot(entry["entry"])
    if "xacro" not in file.read_text(encoding="utf-8"):
        return file.read_text(encoding="utf-8")
    packages = (path.parent for path in robots_folder().rglob("package.xml"))
    environment = {
        **os.environ,
        "PYTHONPATH": str(folder),
        "PACKAGES": "\n".join(map(str, packages)),
    }
    arguments = [f"{name}:={value}" for name, value in entry["xacro_args"].items()]
    run = "import xacro; xacro.main()"
    done = subprocess.run(
        [sys.executable, "-c", run, str(file), *arguments],
        capture_output=True,
        text=True,
        check=True,
        env=environment,
    )
    return done.stdout


@dc.dataclass(frozen=True)
class Case:
    """A robot in Drake and in Pinocchio."""

    name: str

    # As xacro expanded it.
    root: ET.Element

    reference: pinocchio.Model
    robot: ad.Robot
    diagram: Diagram

    @property
    def plant(self) -> MultibodyPlant:
        return self.diagram.GetSubsystemByName("plant")

    @property
    def model(self) -> ModelInstanceIndex:
        return self.plant.GetModelInstanceByName(self.robot.name)

    @property
    def is_unphysical(self) -> bool:
        return bool(UNPHYSICAL & set(read_index()[self.name]["traits"]))

    @functools.cached_property
    def joints(self) -> list[str]:
        """The movable joints, in the order of Pinocchio."""
        return list(self.reference.names)[1:]

    def configurations(self) -> Iterator[dict[str, float]]:
        """Yield positions [rad] or [m] by joint; mimic joints follow."""
        rng = np.random.default_rng(20)
        mimics = {
            joint.attrib["name"]: mimic
            for joint in self.root.iterfind("joint")
            if (mimic := joint.find("mimic")) is not None
        }
        for _ in range(CONFIGURATIONS):
            q = {name: float(rng.uniform(-3.0, 3.0)) for name in self.joints}
            # A mimic joint may follow another one.
            for _ in mimics:
                for name, mimic in mimics.items():
                    multiplier = float(mimic.get("multiplier", 1.0))
                    offset = float(mimic.get("offset", 0.0))
                    q[name] = multiplier * q[mimic.attrib["joint"]] + offset
            yield q

    def reference_positions(self, q: dict[str, float]) -> np.ndarray:
        """Return positions as Pinocchio takes them: cosine and sine if continuous."""
        positions = np.zeros(self.reference.nq)
        for name, value in q.items():
            joint = self.reference.joints[self.reference.getJointId(name)]
            numbers = [value] if joint.nq == 1 else [np.cos(value), np.sin(value)]
            positions[joint.idx_q : joint.idx_q + joint.nq] = numbers
        return positions

    def context(self, q: dict[str, float]) -> Context:
        return make_context(self.plant, self.model, q)


def make_context(
    plant: MultibodyPlant, model: ModelInstanceIndex, q: dict[str, float]
) -> Context:
    context = plant.CreateDefaultContext()
    positions = np.zeros(plant.num_positions())
    for name, value in q.items():
        positions[plant.GetJointByName(name, model).position_start()] = value
    plant.SetPositions(context, positions)
    return context


def make_reference(root: ET.Element) -> pinocchio.Model:
    root = copy.deepcopy(root)
    # It needs an effort and a velocity, and refuses the negative ones of ar4.
    for limit in root.iter("limit"):
        limit.attrib.update(effort="1", velocity="1")
    return pinocchio.buildModelFromXML(ET.tostring(root, encoding="unicode"))


def check_dynamics(
    case: Case,
    reference: pinocchio.Model,
    plant: MultibodyPlant,
    model: ModelInstanceIndex,
) -> None:
    """Compare mass matrices and weights at the configurations of a case."""
    data = reference.createData()
    names = sorted(
        case.joints, key=lambda name: reference.joints[reference.getJointId(name)].idx_v
    )
    at = [plant.GetJointByName(name, model).velocity_start() for name in names]
    mass = sum(inertia.mass for inertia in reference.inertias)
    for q in case.configurations():
        positions = case.reference_positions(q)
        upper = np.triu(pinocchio.crba(reference, data, positions))
        expected = upper + np.triu(upper, 1).T
        weight = pinocchio.computeGeneralizedGravity(reference, data, positions)
        context = make_context(plant, model, q)
        mass_matrix = plant.CalcMassMatrix(context)[np.ix_(at, at)]
        gravity = -plant.CalcGravityGeneralizedForces(context)[at]

        # Beside the largest values that these masses allow (Cauchy and Schwarz):
        # sqrt(M_ii M_jj), and g sqrt(m M_ii) for the weight.
        size = np.sqrt(np.diag(expected))
        error = np.abs(mass_matrix - expected) / np.outer(size, size)
        assert error.max() <= DYNAMICS_TOLERANCE
        error = np.abs(gravity - weight) / (9.81 * np.sqrt(mass) * size)
        assert error.max() <= DYNAMICS_TOLERANCE


@pytest.fixture(scope="module", params=robot_names())
def case(
    request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory
) -> Case:
    entry = read_index()[request.param]
    text = expand(entry, tmp_path_factory.mktemp(request.param))
    robot = load_real_robot(request.param)
    # pinocchio's base is fixed.
    robot = dc.replace(robot, has_free_base=False)
    root = ET.fromstring(text)  # noqa: S314  one we chose.
    return Case(
        name=request.param,
        root=root,
        reference=make_reference(root),
        robot=robot,
        diagram=ad.build_diagram(robot, world="void"),
    )


def test_both_have_the_same_joints_and_links(case: Case) -> None:
    movable = [joint.name for joint in case.robot.description.movable_joints]
    links = [link.attrib["name"] for link in case.root.iterfind("link")]

    assert sorted(movable) == sorted(case.joints)
    assert list(case.robot.description.links) == links
    assert case.plant.num_velocities(case.model) == case.reference.nv


def test_all_links_are_where_pinocchio_finds_them(case: Case) -> None:
    links = [link.attrib["name"] for link in case.root.iterfind("link")]
    reference, data = case.reference, case.reference.createData()

    for q in case.configurations():
        pinocchio.framesForwardKinematics(reference, data, case.reference_positions(q))
        context = case.context(q)
        for link in links:
            if link == "world":
                continue
            frame = reference.getFrameId(link, pinocchio.FrameType.BODY)
            body = case.plant.GetBodyByName(link, case.model)
            np.testing.assert_allclose(
                body.EvalPoseInWorld(context).GetAsMatrix4(),
                data.oMf[frame].homogeneous,
                rtol=0.0,
                atol=POSE_TOLERANCE,
                err_msg=link,
            )


def test_mass_matrix_and_weight_are_those_of_pinocchio(case: Case) -> None:
    if not case.is_unphysical:
        check_dynamics(case, case.reference, case.plant, case.model)


def test_drake_takes_the_repaired_inertias_as_they_are(
    case: Case, caplog: pytest.LogCaptureFixture
) -> None:
    description = case.robot.description
    links, joints = description.link_infos, description.joints
    report = LoadReport(case.robot.report)
    plant = MultibodyPlant(0.001)

    links = repair_inertials(links, joints, report, description.file)

    text = write_urdf("robot", links, joints)
    # Only what the survey of these robots found is repaired, and all of it.
    assert bool(repaired_links(report)) == case.is_unphysical
    with caplog.at_level(logging.WARNING, logger="drake"):
        Parser(plant).AddModelsFromString(text, "urdf")
    messages = [record.getMessage() for record in caplog.records]
    assert not [message for message in messages if "inertia" in message]
    for link in description.roots:
        plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(link))
    plant.Finalize()
    root = ET.fromstring(text)  # noqa: S314  our own.
    check_dynamics(case, make_reference(root), plant, ModelInstanceIndex(2))
    Simulator(plant).AdvanceTo(0.002)


def repaired_links(report: LoadReport) -> set[str]:
    """Return the places, such as "link 'a'", whose inertia was repaired."""
    places = {entry.where for entry in report if entry.kind == "repair"}
    return {place for place in places if re.fullmatch(r"link '[^']*'", place)}
