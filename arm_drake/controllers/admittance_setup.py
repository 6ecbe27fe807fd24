"""What an AdmittanceController makes of its parameters, and what it refuses."""

from collections.abc import Collection
from operator import attrgetter
from typing import NamedTuple

import numpy as np

from arm_drake.control.admittance import AdmittanceRule, ChainKinematics
from arm_drake.controllers.admittance_parameters import AdmittanceControllerParameters
from arm_drake.controllers.controller_interface_part import ControllerInterfaceParams
from arm_drake.errors import ParameterError, suggest

# Parameters that can't change while the controller runs. Upstream lets those of the
# kinematics and the sensor's name change, without any effect.
_READ_ONLY = (
    "joints",
    "command_joints",
    "command_interfaces",
    "state_interfaces",
    "chainable_command_interfaces",
    "kinematics",
    "ft_sensor.name",
)

_LINKS = (
    "kinematics.base",
    "kinematics.tip",
    "ft_sensor.frame.id",
    "control.frame.id",
    "fixed_world_frame.frame.id",
    "gravity_compensation.frame.id",
)


class AdmittanceSetup(NamedTuple):
    """What an AdmittanceController's parameters set."""

    parameters: AdmittanceControllerParameters
    rule: AdmittanceRule

    # Links of the sensor, of the control frame, of the centre of gravity, and the one
    # whose z axis points up.
    sensor: str
    control: str
    center: str
    world: str


def make_setup(
    given: AdmittanceControllerParameters, links: Collection[str]
) -> AdmittanceSetup:
    """Return what parameters set.

    Args:
        given: The parameters.
        links: Links of the robot.

    Raises:
        ParameterError: If a link doesn't exist.
    """
    for name in _LINKS:
        link = attrgetter(name)(given)
        if link not in links:
            raise ParameterError(
                f"{name}: the robot has no link {link!r}; {suggest(link, links)}"
            )
    law, load = given.admittance, given.gravity_compensation
    rule = AdmittanceRule(
        selected_axes=law.selected_axes,
        mass=np.array(law.mass),
        damping_ratio=np.array(law.damping_ratio),
        stiffness=np.array(law.stiffness),
        joint_damping=law.joint_damping,
        alpha=given.kinematics.alpha,
        filter_coefficient=given.ft_sensor.filter_coefficient,
        weight=load.CoG.force,
        center_of_gravity=np.array(load.CoG.pos),
    )
    return AdmittanceSetup(
        given,
        rule,
        given.ft_sensor.frame.id,
        given.control.frame.id,
        load.frame.id,
        given.fixed_world_frame.frame.id,
    )


def make_kinematics(
    given: AdmittanceControllerParameters, params: ControllerInterfaceParams
) -> ChainKinematics:
    """Return the kinematics of the joints, seen from the base of their chain.

    Args:
        given: The parameters; their links exist.
        params: Surroundings of the controller.

    Raises:
        ParameterError: If a joint doesn't exist, or they make no chain.
    """
    if params.make_kinematics is None:
        raise ParameterError("nothing is known of the robot's kinematics")
    for joint in given.joints:
        if joint not in params.joint_types:
            raise ParameterError(
                f"joints: the robot has no joint {joint!r}; "
                f"{suggest(joint, params.joint_types)}"
            )
    base, tip = given.kinematics.base, given.kinematics.tip
    kinematics = params.make_kinematics(given.joints, base)
    chain, joints = kinematics.joints_to(tip), set(given.joints)
    if not set(chain) - params.followed.keys() <= joints <= set(chain):
        raise ParameterError(
            f"joints: expected those from kinematics.base {base!r} to kinematics.tip "
            f"{tip!r}, {list(chain)}, got {list(given.joints)}"
        )
    frame = given.ft_sensor.frame.id
    if not joints & set(kinematics.joints_to(frame)):
        raise ParameterError(
            f"ft_sensor.frame.id: none of joints moves link {frame!r} against "
            f"kinematics.base {base!r}"
        )
    return kinematics


def check_change(
    old: AdmittanceControllerParameters, new: object
) -> AdmittanceControllerParameters:
    """Return parameters that may take the place of others while a controller runs.

    Args:
        old: Parameters in effect.
        new: What is to take their place.

    Raises:
        ValueError: If it can't.
    """
    if not isinstance(new, AdmittanceControllerParameters):
        raise ValueError(f"expected AdmittanceControllerParameters, got {new!r}")
    for name in _READ_ONLY:
        if attrgetter(name)(new) != attrgetter(name)(old):
            raise ValueError(f"{name} can't change while the controller runs")
    return new
