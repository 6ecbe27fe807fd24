"""A transparent copy of a robot at other joint positions: a goal, or a command."""

import math
from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from pydrake.geometry import Meshcat, Rgba, Role, SceneGraph
from pydrake.math import RigidTransform
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import ModelInstanceIndex, RigidBody
from pydrake.systems.framework import Context

from arm_drake.description.joints import last_master, links_on
from arm_drake.description.urdf import RobotDescription
from arm_drake.errors import InputError, check_known
from arm_drake.visualization.link_drawings import (
    DrawnRobot,
    draw_solid,
    path_below,
    visual_solid,
)

BLUE = (0.1, 0.5, 1.0)
_ALPHA = 0.35


# Two poses are as good as one if they differ by no more [m] and [rad].
_NEAR, _ALIGNED = 2e-3, 1e-2


class _DrawnBody(NamedTuple):
    body: RigidBody
    path: str

    # Whether it moves with the base.
    is_attached: bool


class Ghost:
    """A robot's visual shapes in one transparent colour, at joint positions of its own.

    They are sent at the first `show`, below ``/drake/ghost/<name>/<link>``; after that
    only transforms are, of links that moved.
    """

    def __init__(
        self,
        meshcat: Meshcat,
        plant: MultibodyPlant,
        scene_graph: SceneGraph,
        model: ModelInstanceIndex,
        name: str,
        description: RobotDescription,
        *,
        base_context: Context | None = None,
        color: tuple[float, float, float] = BLUE,
    ) -> None:
        """Create it; nothing is shown yet.

        Where nothing else is said, positions are those of `base_context` as they are
        now, by default of the plant's default one. `color` is red, green and blue from
        0 to 1.
        """
        self._meshcat = meshcat
        self._plant = plant
        self._name = name
        self._robot = DrawnRobot(plant, scene_graph, model, description)
        self._rgba = Rgba(*color, _ALPHA)
        self._context = plant.CreateDefaultContext()
        source_context = self._context if base_context is None else base_context
        self._rest = plant.GetPositions(source_context)
        joints = {joint.name: joint for joint in description.movable_joints}
        self._at = {
            joint: plant.GetJointByName(joint, model).position_start()
            for joint in joints
        }
        # Of mimic joints: master, factor and offset.
        self._followers = {
            name: last_master(joint, joints)
            for name, joint in joints.items()
            if joint.mimic is not None
        }
        # A robot on a link called "world" has the world as its base.
        self._base: RigidBody | None = None
        if description.roots:
            self._base = plant.GetBodyByName(description.base, model)
        self._bodies: list[_DrawnBody] | None = None
        # Paths of what has a colour.
        self._solids: list[str] = []
        self._sent: dict[str, RigidTransform] = {}
        self._hidden: set[str] = set()
        self._is_shown = False

    @property
    def path(self) -> str:
        """Path in Meshcat."""
        return path_below("/drake/ghost", self._name)

    def show(
        self,
        positions: Mapping[str, float],
        *,
        base_pose: RigidTransform | None = None,
        time: float | None = None,
        hidden_at: Mapping[str, RigidTransform] | None = None,
    ) -> None:
        """Show the robot at joint positions [rad] or [m], or raise InputError.

        Joints that are left out, and the base, stay as in the base context; a mimic
        joint follows its master if that is given and it isn't itself. `time` [s] is
        that in the recording, if there is one. Links at the poses `hidden_at` are left
        out: there something else is, and two shapes in one place are hard to look at.
        """
        q = self._resolve(positions)
        if self._bodies is None:
            self._bodies = self._draw()
        self._place(self._bodies, q, base_pose, time, hidden_at or {})
        if not self._is_shown:
            self._is_shown = True
            self._meshcat.SetProperty(self.path, "visible", True)

    def hide(self) -> None:
        """Hide it; `show` shows it again."""
        if self._is_shown:
            self._is_shown = False
            self._meshcat.SetProperty(self.path, "visible", False)

    def set_color(self, color: tuple[float, float, float]) -> None:
        """Change its colour: red, green and blue from 0 to 1."""
        rgba = Rgba(*color, _ALPHA)
        if rgba == self._rgba:
            return
        self._rgba = rgba
        # A browser that comes later gets what lies below a path after its properties.
        for path in self._solids:
            self._meshcat.SetProperty(path, "color", [*color, _ALPHA])

    def _resolve(self, positions: Mapping[str, float]) -> np.ndarray:
        """Return the positions of the whole plant."""
        q = self._rest.copy()
        for joint, value in positions.items():
            ghost = f"ghost {self._name!r}"
            check_known("joint", joint, self._at, argument=ghost)
            if not math.isfinite(value):
                problem = f"expected a finite number [rad or m], got {value}"
                raise InputError(f"{ghost}: joint {joint!r}: {problem}")
            q[self._at[joint]] = value
        for joint, (master, factor, offset) in self._followers.items():
            if joint not in positions and master in positions:
                q[self._at[joint]] = factor * positions[master] + offset
        return q

    def _place(
        self,
        bodies: list[_DrawnBody],
        q: np.ndarray,
        base_pose: RigidTransform | None,
        time: float | None,
        hidden_at: Mapping[str, RigidTransform],
    ) -> None:
        plant, context = self._plant, self._context
        plant.SetPositions(context, q)
        # How far the base is moved from where the positions have it.
        X_WM = RigidTransform()
        if base_pose is not None:
            X_WM = base_pose
            if self._base is not None:
                X_WM @= plant.EvalBodyPoseInWorld(context, self._base).inverse()
        for body, path, is_attached in bodies:
            X_WB = plant.EvalBodyPoseInWorld(context, body)
            if is_attached:
                X_WB = X_WM @ X_WB
            other = hidden_at.get(body.name())
            is_hidden = other is not None and _are_close(X_WB, other)
            if is_hidden != (path in self._hidden):
                self._hidden ^= {path}
                self._meshcat.SetProperty(path, "visible", not is_hidden)
            known = self._sent.get(path)
            # Between pictures of a recording, Meshcat interpolates.
            if time is not None or known is None or not known.IsExactlyEqualTo(X_WB):
                self._sent[path] = RigidTransform(X_WB)
                self._meshcat.SetTransform(path, X_WB, time)

    def _draw(self) -> list[_DrawnBody]:
        robot, inspector = self._robot, self._robot.inspector
        attached = set(robot.description.links)
        if self._base is not None:
            attached = links_on(robot.description.joints, self._base.name())
        bodies = []
        for body, link, _ in robot.parts:
            path = path_below(self.path, body.name())
            is_drawn = False
            for index, geometry in enumerate(robot.shapes(body, Role.kIllustration)):
                solid = visual_solid(inspector, geometry)
                if solid is not None:
                    own = path_below(path, str(index))
                    X_BG = inspector.GetPoseInFrame(geometry)
                    self._meshcat.SetTransform(own, X_BG)
                    draw_solid(self._meshcat, own, solid, self._rgba)
                    self._solids.append(f"{own}/<object>")
                    is_drawn = True
            if is_drawn:
                bodies.append(_DrawnBody(body, path, link in attached))
        return bodies


def _are_close(one: RigidTransform, other: RigidTransform) -> bool:
    shift = one.translation() - other.translation()
    turn = one.rotation().inverse().multiply(other.rotation()).matrix()
    # The trace of a rotation by an angle is 1 + 2 cos(angle).
    cosine = 0.5 * (np.trace(turn) - 1.0)
    return bool(np.linalg.norm(shift) <= _NEAR and cosine >= math.cos(_ALIGNED))
