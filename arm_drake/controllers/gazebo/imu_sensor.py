"""Gazebo's inertial measurement units (IMUs).

Sources: gz-sensors, src/ImuSensor.cc, GaussianNoiseModel.cc; gazebo_ros_pkgs, branch
ros2, gazebo_plugins/src/gazebo_ros_imu_sensor.cpp.
"""

import math
import zlib

import numpy as np
from pydrake.common.value import AbstractValue
from pydrake.math import RollPitchYaw
from pydrake.systems.framework import Context, DiscreteValues

from arm_drake import interfaces
from arm_drake.arrays import Array
from arm_drake.controllers.controller_interface import (
    ControllerInterface,
    ControllerInterfaceParams,
)
from arm_drake.controllers.gazebo.plugin import imu_topic
from arm_drake.description.gazebo_plugins import ImuSensorTag, Noise
from arm_drake.messages import NANOSECONDS, Header, Quaternion, Vector3
from arm_drake.messages.sensors import Imu

# Times of ticks are cut to whole nanoseconds; so much of a period they may be early.
_EARLY = 1e-6

_NO_COVARIANCE = (0.0,) * 9

# What `sensor_msgs/Imu` asks for where there is no orientation.
_NO_ORIENTATION = (-1.0, *_NO_COVARIANCE[1:])


class ImuSensor(ControllerInterface):
    """Publishes what an IMU of a robot measures, at a rate.

    .. pydrake_system::

        name: ImuSensor
        input_ports:
        - controller_manager
        - state_interfaces
        - readings
        output_ports:
        - /<topic>

    ==================  ====  ======  ==================================================
    port                size  unit    meaning
    ==================  ====  ======  ==================================================
    controller_manager  --    --      Cycle: the time, and whether the IMU is active
    state_interfaces    2J    rad,    positions and velocities of all joints, or more;
                              rad/s   not read
    readings            10    rad/s,  orientation in the world as x, y, z, w, angular
                              m/s^2   velocity, and acceleration less that of free fall,
                                      along the sensor's axes; without physics not
                                      connected
    /<topic>            --    --      Imu: the last sample; empty before the first one
                                      and while inactive
    ==================  ====  ======  ==================================================

    It measures in the first tick, then in the first one of each 1 / ``update_rate``;
    with a rate of 0 in all. The orientation q is told relative to that of a frame r,
    q_r^-1 q: of the one that the tag names, or of the sensor's own in the first tick.

    Noise of angular velocity and acceleration is Gazebo's. Of each axis::

        y_k = x_k + b_k + mean + stddev n_k
        b_k = phi b_k-1 + sigma m_k,  phi = exp(-dt / tau)
        sigma^2 = dynamic_bias_stddev^2 tau / 2 (1 - phi^2)

    with n and m normally distributed, the time dt since the last sample, tau the
    ``dynamic_bias_correlation_time``, and b_0 drawn from ``bias_mean`` and
    ``bias_stddev``, to either side. It follows from the seed, the robot, the sensor and
    the time of the tick alone.

    The state is discrete: the time of the sample [ns], which is NaN where there is
    none, the sample, the bias, and the frame's orientation, 0 before the first tick.
    Drake updates it after what is unrestricted: the manager has run its cycle, and the
    acceleration is that of the step which begins now.
    """

    def __init__(self, tag: ImuSensorTag, params: ControllerInterfaceParams) -> None:
        """Create the system."""
        super().__init__(params)
        self._rate, self._has_orientation = tag.update_rate, tag.has_orientation
        default = f"{params.robot_name}/{tag.merged or tag.link}/{tag.name}"
        self._frame_id = tag.frame_id or (tag.link if tag.is_classic else default)
        self._covariances = [_covariance(tag.noise[:3]), _covariance(tag.noise[3:])]
        self._noise = _NoiseModel(tag.noise) if tag.noise != (Noise(),) * 6 else None
        name = f"{params.robot_name}/{params.controller_name}"
        self._seed = (params.seed, zlib.crc32(name.encode()))
        size = len(interfaces.IMU)
        self._readings = self.DeclareVectorInputPort(interfaces.READINGS_PORT, size)
        bias, reference = np.zeros(6), np.zeros(4)
        if self._noise is not None:
            bias = self._noise.initial_bias(np.random.default_rng(self._seed))
        if tag.reference is not None:
            q = RollPitchYaw(*tag.reference).ToQuaternion()
            reference = np.append(q.xyz(), q.w())
        # Drake takes a plain number quicker than its own kind of index.
        self._time = int(self.DeclareDiscreteState([math.nan]))
        self._sample = int(self.DeclareDiscreteState(size))
        self._bias = int(self.DeclareDiscreteState(bias))
        self._reference = int(self.DeclareDiscreteState(reference))
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._update_sample)
        self.DeclareAbstractOutputPort(
            imu_topic(tag, params.robot_name, params.world_name),
            lambda: AbstractValue.Make(Imu()),
            self._calc_imu,
            # The manager says whether it is active.
            prerequisites_of_calc={self.xd_ticket(), self._manager.ticket()},
        )

    def _update_sample(self, context: Context, state: DiscreteValues) -> None:
        reference = context.get_discrete_state(self._reference).value()
        is_first = not reference.any()
        if is_first and self._readings.HasValue(context):
            reference = self._readings.Eval(context)[:4]
            state.set_value(self._reference, reference)
        elif is_first:
            return
        last_ns = float(context.get_discrete_state(self._time).value()[0])
        # The manager is asked when it matters: it makes its cycle for who asks.
        if not self._is_due(context.get_time() * NANOSECONDS, last_ns):
            return
        if not self._readings.HasValue(context):  # Nothing measures without physics.
            return
        if not self._is_active(context):
            state.set_value(self._time, [math.nan])
            return
        time_ns = self._time_ns(context)
        sample = np.array(self._readings.Eval(context))
        sample[:4] = _relative(reference, sample[:4])
        if self._noise is not None:
            dt = 0.0 if math.isnan(last_ns) else (time_ns - last_ns) / NANOSECONDS
            bias = context.get_discrete_state(self._bias).value()
            random = np.random.default_rng((*self._seed, time_ns))
            sample[4:], bias = self._noise.add(sample[4:], bias, dt, random)
            state.set_value(self._bias, bias)
        state.set_value(self._time, [time_ns])
        state.set_value(self._sample, sample)

    def _is_due(self, time_ns: float, last_ns: float) -> bool:
        """Return whether a tick measures, by the time of the last one that did."""
        if math.isnan(last_ns) or not self._rate:
            return True
        numbers = (ns / NANOSECONDS * self._rate + _EARLY for ns in (time_ns, last_ns))
        number, last = map(math.floor, numbers)
        return number > last

    def _calc_imu(self, context: Context, output: AbstractValue) -> None:
        time_ns = float(context.get_discrete_state(self._time).value()[0])
        message = Imu()
        if not math.isnan(time_ns) and self._is_active(context):
            values = context.get_discrete_state(self._sample).value().tolist()
            q, w, a = values[:4], values[4:7], values[7:]
            is_told = self._has_orientation
            message = Imu(
                Header.from_nanoseconds(int(time_ns), self._frame_id),
                Quaternion(*(q if is_told else (0.0,) * 4)),
                _NO_COVARIANCE if is_told else _NO_ORIENTATION,
                Vector3(*w),
                self._covariances[0],
                Vector3(*a),
                self._covariances[1],
            )
        output.set_value(message)


class _NoiseModel:
    """Noise of n axes."""

    def __init__(self, noise: tuple[Noise, ...]) -> None:
        def column(name: str) -> Array:
            return np.array([getattr(each, name) for each in noise])

        self._mean, self._stddev = column("mean"), column("stddev")
        self._bias_mean, self._bias_stddev = column("bias_mean"), column("bias_stddev")
        self._precision = column("precision")
        deviation = column("dynamic_bias_stddev")
        tau = column("dynamic_bias_correlation_time")
        # Axes whose bias wanders.
        self._wandering = np.flatnonzero((deviation > 0.0) & (tau > 0.0))
        self._deviation, self._tau = deviation[self._wandering], tau[self._wandering]

    def initial_bias(self, random: np.random.Generator) -> Array:
        """Return the bias before the first sample, shape (n,)."""
        sides = random.choice((-1.0, 1.0), len(self._mean))
        return sides * random.normal(self._bias_mean, self._bias_stddev)

    def add(
        self, values: Array, bias: Array, dt: float, random: np.random.Generator
    ) -> tuple[Array, Array]:
        """Return values with noise, and the bias that they have, shape (n,) each.

        `bias` is that of the last sample, `dt` [s] ago.
        """
        white, drift = random.standard_normal((2, len(values)))
        if len(at := self._wandering):
            decay = -np.expm1(-2.0 * dt / self._tau)
            sigma = self._deviation * np.sqrt(self._tau / 2.0 * decay)
            bias = np.array(bias)
            bias[at] = np.exp(-dt / self._tau) * bias[at] + sigma * drift[at]
        noisy = values + bias + self._mean + self._stddev * white
        at = np.flatnonzero(self._precision)
        noisy[at] = np.round(noisy[at] / self._precision[at]) * self._precision[at]
        return noisy, bias


def _covariance(noise: tuple[Noise, ...]) -> tuple[float, ...]:
    """Return the covariance of three axes, row by row."""
    # Unlike a power, a product that is too large is infinite.
    variances = [each.stddev * each.stddev for each in noise]
    return tuple(np.diag(variances).ravel().tolist())


def _relative(reference: Array, orientation: Array) -> list[float]:
    """Return an orientation relative to another one, all as x, y, z, w."""
    (x, y, z, w), (i, j, k, s) = reference.tolist(), orientation.tolist()
    return [
        w * i - s * x - y * k + z * j,
        w * j - s * y - z * i + x * k,
        w * k - s * z - x * j + y * i,
        w * s + x * i + y * j + z * k,
    ]
