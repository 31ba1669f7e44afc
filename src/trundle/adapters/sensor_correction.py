"""What sensors really measured, where their own numbers are known to be off: gains, offsets, delays."""

from __future__ import annotations

import dataclasses

import numpy as np

from trundle.geometry import se2
from trundle.records import Trajectory, WheelLog
from trundle.robot import LogMapping
from trundle.robot.log_mapping import ReferenceMapping, ScalarMapping, Unit

__all__ = ["corrected"]


def corrected(log: WheelLog, mapping: LogMapping) -> WheelLog:
    """The log with steering angles, yaw rate and the reference's stamps as they should have been.

    Args:
        log: As its sensors said it, in SI units.
        mapping: Gain and offset of angles and yaw rate, angles that wrap, delay of the reference.
    """
    steering, yaw_rate, reference = log.steering, log.yaw_rate, log.reference
    known = [mapping.steering.get(name) for name in log.steering_names]
    if steering is not None and any(one is not None and _is_off(one) for one in known):
        gains = np.array([1.0 if one is None or one.unit is Unit.TICKS else one.gain for one in known])
        offsets = np.array([0.0 if one is None else one.offset for one in known])
        steering = gains * steering + offsets
    wrapping = [one is not None and one.wraps for one in known]
    if steering is not None and any(wrapping):
        steering = np.where(wrapping, se2.wrap(steering), steering)
    if yaw_rate is not None and mapping.gyro is not None and _is_off(mapping.gyro):
        yaw_rate = mapping.gyro.gain * yaw_rate + mapping.gyro.offset
    if reference is not None and mapping.reference is not None and mapping.reference.delay:
        reference = _earlier(reference, mapping.reference)
    if steering is log.steering and yaw_rate is log.yaw_rate and reference is log.reference:
        return log
    return dataclasses.replace(log, steering=steering, yaw_rate=yaw_rate, reference=reference)


def _is_off(mapping: ScalarMapping) -> bool:
    return (mapping.gain, mapping.offset) != (1.0, 0.0)


def _earlier(reference: Trajectory, mapping: ReferenceMapping) -> Trajectory:
    return dataclasses.replace(reference, time_ns=reference.time_ns - round(mapping.delay * 1e9))
