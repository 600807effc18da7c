"""``yawrate/PITuningNonlinear-v0``: the same task, recorded on the nonlinear vehicle."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, ClassVar

from yawrate_env.env.vector_env import PITuningVectorEnv
from yawrate_env.env.yaw_rate_env import PITuningEnv
from yawrate_env.vehicle.nonlinear.twin import NonlinearTwin

Parameters = Mapping[str, float] | None


class PITuningNonlinearEnv(PITuningEnv):
    """`PITuningEnv` whose episodes are driven on saturating tyres.

    Spaces, rewards, information and arguments are those of ``yawrate/PITuning-v0``.
    Margins are those of the linearisation about straight driving, which is the linear
    vehicle; `yawrate_env.vehicle.nonlinear.time_domain` judges a loop on the nonlinear one.

    ## Further arguments

    | name | default | meaning |
    |---|---|---|
    | `tyre` | `{}` | any of `shape`, `curvature`, `friction`, `friction_loss`, `stiffest_load` |
    | `body` | `{}` | any of `height`, `track`, `front_share`, `roll_lag`, `drag` |
    | `limits` | `{}` | any of `angle` [rad], `rate` [rad/s], of the road wheel |

    ## Version history

    * v0: first version.
    """

    def __init__(
        self,
        *,
        tyre: Parameters = None,
        body: Parameters = None,
        limits: Parameters = None,
        **linear: Any,
    ) -> None:
        super().__init__(**linear)
        self.task = replace(self.task, twin=NonlinearTwin.of(tyre=tyre, body=body, limits=limits))


class PITuningNonlinearVectorEnv(PITuningVectorEnv):
    """`num_envs` of `PITuningNonlinearEnv` in one batch."""

    scalar: ClassVar[type[PITuningEnv]] = PITuningNonlinearEnv
