"""The vehicle's words: columns of logs, and what checks of a recording say where they fail."""

import numpy as np

from yawrate_env.vehicle.plausible import LARGEST_ANGLE, LARGEST_YAW_RATE

HAND_WHEEL = (
    "hand wheel angle",
    "hand wheel",
    "hand wheel steer angle",
    "steer wheel",
    "steer sw",
    "delta h",
)
"""Column names of angles before the steering gear."""

SYNONYMS = {
    "input": (
        "steer command",
        "steer angle command",
        "delta command",
        "delta f command",
        "road wheel angle command",
        "front wheel angle command",
        "wheel steer angle command",
        "wheel steer angle",
        "road wheel angle",
        "road wheel steer angle",
        "road steer angle",
        "front wheel angle",
        "front wheel steer angle",
        "front steer angle",
        "road angle",
        "rwa",
        "steer angle",
        "delta f",
        "steer",
        "delta",
        *HAND_WHEEL,
        "hand wheel angle command",
        "command",
        "u",
    ),
    "output": (
        "yaw rate",
        "yaw speed",
        "yaw angular speed",
        "yaw angular rate",
        "yaw dot",
        "psi dot",
        "psi rate",
        "psi speed",
        "gyro z",
        "gyro yaw",
        "omega z",
        "angular speed z",
        "angular rate z",
        "angle rate z",
        "angular z",
        "rate z",
        "heading rate",
        "turn rate",
        "yaw gyro",
        "gyro",
        "omega",
        "r",
        "y",
        "yaw",
    ),
    "v_x": (
        "longitudinal speed",
        "speed x",
        "linear speed x",
        "linear x",
        "ground speed",
        "v x",
        "v longitudinal",
        "v",
        "speed longitudinal",
    ),
}  # fmt: skip
"""Names of columns in logs (SAE J670, ISO 8855, loggers, simulators, German ones) in the words that
`tuners.logs.names` brings spellings to.  Among symbols the first is preferred."""

CAUTIONS = dict.fromkeys(
    HAND_WHEEL,
    "sounds like the hand wheel, and no --steer-ratio is given: it is taken as the road wheel.",
)

MESSAGES = {
    "implausible": f"Steering beyond {np.degrees(LARGEST_ANGLE):.0f} deg or a yaw rate beyond "
    f"{LARGEST_YAW_RATE:g} rad/s: check the units.",
    "misfit": "No vehicle in the prior reproduces this recording: check units, signs, sampling "
    "time, delays between the channels, speed and the vehicle's data.",
    "response": "At the crossover the recording responds otherwise than the fitted vehicle: "
    "check speed, sampling time and the vehicle's data.",
    "noise": "The yaw rate hardly follows the command: too little steering, a dead or noisy "
    "sensor, or the sensor of another vehicle.",
    "colour": "Something other than the command moves the yaw rate around the crossover: a "
    "disturbance, a drift or a sensor fault.",
    "outside": "The fitted vehicle lies outside the range that the tuner was made for.",
    "phase_margin_error": "With the fitted vehicle these gains miss the target.",
    "crossover_error": "With the fitted vehicle these gains miss the target.",
    "unsolved": "The target cannot be reached, or the numerics did not converge.",
    "speed": "The recording's speed is not one that the tuner was made for: train one for it, "
    "or use one for every speed.",
}
