"""Record of what a tuner sees in recordings before it chooses whose gains answer."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tuners.trust.black_box import BlackBox
from tuners.trust.fit import Fit
from tuners.trust.response import Response
from tuners.tuner.method import Gains
from tuners.tuner.recording import Recording

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """B recordings, their models, and the method's gains.

    Attributes
    ----------
    given, used : Recording
        As recorded, and at the plant's sampling time.
    theta : NDArray
        (B, p) measured parameters, in place of the others the middle of the prior.
    model : BlackBox
        The black box.
    own : Gains
        The method's.
    still : NDArray
        (B,) whether nothing moves.
    fit : Fit
        The fitted plant.
    response : Response, optional
        The black box's, where the plant's metrics are its.
    name : str
        Of the recording, in messages.
    """

    given: Recording
    used: Recording
    theta: Array
    model: BlackBox
    own: Gains
    still: Flags
    fit: Fit
    response: Response | None
    name: str = ""
