"""The measured properties of a donkeycar that does not exist, as its owner would write them down."""

import math

AXLE_LENGTH = 0.16  # between left and right wheels, m
WHEEL_BASE = 0.26  # between front and rear axle, m
WHEEL_RADIUS = 0.032  # m
MIN_SPEED = 0.1  # below it the car stalls, m/s
MAX_SPEED = 2.5  # at full throttle, m/s
MAX_STEERING_ANGLE = math.pi / 6  # at steering -1, rad
ENCODER_PPR = 64
MM_PER_TICK = WHEEL_RADIUS * 2 * math.pi * 1000 / ENCODER_PPR
