"""Which bodies of a plant are a robot's links, and how large the robot is."""

import functools
import itertools
from typing import NamedTuple

import numpy as np
from pydrake.geometry import GeometryId, Role, SceneGraph, SceneGraphInspector
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context

from arm_drake.description.joints import WORLD
from arm_drake.description.urdf import RobotDescription

# A robot without shapes whose links are all in one place counts as so large [m].
_SMALLEST = 0.1


class Part(NamedTuple):
    """A body of the plant, and the link that it moves with."""

    body: RigidBody
    link: str

    # Pose of the body in the link.
    X_LB: RigidTransform


class DrawnRobot:
    """A robot in a plant, as it stands by default.

    A plant may have more bodies than the description has links: rollers of wheels, and
    wheels on axles that the description lacks. They are parts of the link that carries
    them, drawn where they start; they are round.

    A link called "world" is the world itself. What is fixed to it has no shape of the
    robot's own: the world has the ground, too.
    """

    def __init__(
        self,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        model: ModelInstanceIndex,
        description: RobotDescription,
    ) -> None:
        """Create it.

        Args:
            plant: The finalized plant; it is kept.
            scene_graph: Its scene graph; it is kept.
            model: The robot's model instance.
            description: The robot.
        """
        self.plant = plant
        self.model = model
        self.description = description
        self._scene_graph = scene_graph

    @property
    def inspector(self) -> SceneGraphInspector:
        """The scene."""
        return self._scene_graph.model_inspector()

    @functools.cached_property
    def parts(self) -> tuple[Part, ...]:
        """The robot's bodies; those that no link carries are left out."""
        plant, links = self.plant, set(self.description.links)
        bodies = [plant.get_body(index) for index in plant.GetBodyIndices(self.model)]
        joints = [plant.get_joint(index) for index in plant.GetJointIndices(self.model)]
        carriers = {joint.child_body().name(): joint.parent_body() for joint in joints}
        parts = []
        for body in bodies:
            link = body
            while link.name() not in links and link.name() in carriers:
                link = carriers[link.name()]
            if link.name() in links:
                X_LB = self._pose(link).inverse() @ self._pose(body)
                parts.append(Part(body, link.name(), X_LB))
        return tuple(parts)

    @functools.cached_property
    def link_poses(self) -> dict[str, RigidTransform]:
        """Where the links are by default, in the order of the description."""
        plant = self.plant
        return {
            link: RigidTransform()
            if link == WORLD
            else self._pose(plant.GetBodyByName(link, self.model))
            for link in self.description.links
        }

    @functools.cached_property
    def size(self) -> float:
        """Diagonal of the box around all links and shapes, by default [m]."""
        points = [X_WL.translation() for X_WL in self.link_poses.values()]
        signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
        for part in self.parts:
            X_WB = self._pose(part.body)
            for role in (Role.kIllustration, Role.kProximity):
                for geometry in self.shapes(part.body, role):
                    box = self.inspector.GetObbInGeometryFrame(geometry)
                    if box is None:
                        continue
                    X_BG = self.inspector.GetPoseInFrame(geometry)
                    corners = (signs * box.half_width()).T
                    X_WO = X_WB @ X_BG @ box.pose()
                    points += list(X_WO.multiply(corners).T)
        return max(float(np.linalg.norm(np.ptp(points, axis=0))), _SMALLEST)

    def shapes(self, body: RigidBody, role: Role) -> list[GeometryId]:
        """Return the shapes that a body has for a purpose."""
        frame = self.plant.GetBodyFrameIdIfExists(body.index())
        return [] if frame is None else list(self.inspector.GetGeometries(frame, role))

    def _pose(self, body: RigidBody) -> RigidTransform:
        return self.plant.EvalBodyPoseInWorld(self._default, body)

    @functools.cached_property
    def _default(self) -> Context:
        return self.plant.CreateDefaultContext()
