"""What the checks of a recording allow, and what they say where it is exceeded."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Limits:
    """Largest values that pass; those of the metrics are in `Metric`.

    Attributes
    ----------
    implausible : float
        Largest input or output over what a recording of the plant can hold.
    misfit : float
        Output that the input explains and the fitted plant does not, over the output,
        beyond what noise can do.
    response : float
        Relative difference of fitted plant and black box at the crossover, beyond what
        noise can do; 0.02 is about a degree.
    noise : float
        Residual over simulated output, root mean squares.
    colour : float
        Power of the residual around the crossover over that of white noise; half of all its
        power there if that is less.
    outside : float
        Distance of the fitted plant from the prior in widths of its ranges, beyond what
        noise can do.
    vague : float
        Standard deviation of a metric over the one that needs no care, where the black box asks
        for other gains than the fitted plant.
    disturbed : float
        As `colour`, where the black box asks for other gains than the fitted plant.
    lingering : float
        What is taken for the start's free response and lasts longer than it can, over the
        output, root mean squares.
    bend : float
        Metrics by which no amplitude differs from the recording's, over their `error`, beyond what
        noise can do.
    halves : float
        Metrics by which the recording's halves differ from the whole, beyond what noise can do,
        over their `error`.
    parts : float
        Standard deviation of a metric, over the widest that is not refused, where parts of the
        recording ask for other gains than the whole.
    sticking : float
        Metrics by which an actuator that sticks, has a dead band, or follows late or slowly would
        explain the recording, over what is called a miss.
    louder : float
        Residual over the noise that the plant declares, root mean squares.
    pattern : float
        Residual over simulated output, root mean squares, where it is coloured and larger than
        the noise that the plant declares.
    feedback, reference : float
        Correlation of what is new in the output with what is new in the input, or in the
        reference, at once, in standard deviations.
    limited : float
        Whether the target is out of the controller's reach, as 1 or 0.
    undesigned : float
        Whether the design rule has no gains for the fitted plant, as 1 or 0.
    unsolved : float
        Whether there are no gains or the numerics failed, as 1 or 0.
    """

    implausible: float = 1.0
    misfit: float = 0.01
    response: float = 0.02
    noise: float = 0.3
    colour: float = 20.0
    outside: float = 0.1
    vague: float = 1.3
    disturbed: float = 3.0
    lingering: float = 0.02
    bend: float = 0.3
    halves: float = 1.0
    parts: float = 1 / 3
    sticking: float = 0.25
    louder: float = 2.0
    pattern: float = 0.01
    feedback: float = 4.0
    reference: float = 4.0
    limited: float = 0.0
    undesigned: float = 0.0
    unsolved: float = 0.0


MESSAGES = {
    "implausible": "The input or the output is larger than it can be: check the units.",
    "misfit": "No plant in the prior reproduces this recording: check units, signs, sampling "
    "time, delays between the channels and the initial state.",
    "response": "At the crossover the recording's response differs from the fitted plant's: check "
    "the sampling time and the measured parameters.",
    "noise": "The output hardly follows the input: the sensor is dead, noisy or not the plant's.",
    "colour": "Something other than the input moves the output around the crossover: a "
    "disturbance, a drift or a sensor fault.",
    "outside": "The fitted plant lies outside the prior that the tuner was made for.",
    "vague": "The recording contradicts the fitted plant, and tells too little to do without it: "
    "excite more strongly, more quickly, or for longer.",
    "disturbed": "The recording contradicts the fitted plant, but something other than the input "
    "moves the output around the crossover, which may be why: record while less disturbs it.",
    "lingering": "The output changes as after a start that the plant should have forgotten: the "
    "operating point moves, or the plant is not linear.",
    "bend": "The output does not grow in proportion to the input: the plant or the sensor "
    "saturates. Excite with the amplitude that the loop will have.",
    "halves": "The response changes during the recording: the operating point moves, or "
    "something breaks. Record while all stays as it is.",
    "parts": "Parts of the recording ask for other gains than the whole: the plant is not as "
    "simulated, drifts or is disturbed, or its actuator saturates or has a curve.",
    "sticking": "The actuator does not seem to follow the command at once: it sticks, has a dead "
    "band, or follows late or slowly. Stroke the valve, or log its position as the input.",
    "louder": "The residual is larger than the noise that the plant declares: the sensor is "
    "noisier, or the plant is not as simulated.",
    "pattern": "The residual is not noise but has a pattern: the plant is not as simulated, drifts "
    "or is disturbed. Compare the fitted plant with the recording.",
    "feedback": "The input answers the output: this was recorded in a closed loop, where noise and "
    "disturbances look like the plant. Give the reference (--reference), or the gains of the "
    "controller that drove (--old-kp, --old-Ti).",
    "reference": "The reference answers the output: it is not this loop's, the old controller had "
    "other gains, or it saw another output than the logged one.",
    "limited": "The controller cannot reach the target with this plant: the gains come as near as "
    "it can.",
    "undesigned": "The design rule has no gains for the plant that fits the recording: ask for "
    "another target.",
    "unsolved": "A number is missing or a search did not converge.",
}
