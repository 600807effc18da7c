"""Show pictures of an episode: as arrays of pixels, or in a window."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from yawrate_env import ENV_ID
from yawrate_env.env.rendering import SIZE, STYLE, Gains, figure, paint, pixels
from yawrate_env.vehicle.single_track import Context
from yawrate_env.vehicle.task import Task

if TYPE_CHECKING:
    from matplotlib.figure import Figure

HUMAN_PAUSE = 1.0
"""How long a frame stays in the window [s]; the environment's `render_fps` is 1."""


class Window:
    """Turn pictures into arrays, or show them one after the other in a window.

    Parameters
    ----------
    human : bool
        Show a window, where matplotlib has one to show; otherwise draw nothing.
    """

    def __init__(self, human: bool) -> None:
        self._human = human
        self._shown: Figure | None = None

    def draw(
        self, task: Task, context: Context, obs: NDArray[np.float32], gains: Gains
    ) -> NDArray[np.uint8] | None:
        """Draw an episode as `figure` does.

        Returns
        -------
        (H, W, 3) uint8, or None
            The pixels; None if they went to the window.
        """
        if not self._human:
            return pixels(figure(task, context, obs, gains))
        if self._open():
            self._update(task, context, obs, gains)
        return None

    def close(self) -> None:
        """Close the window, if there is one; may be called twice."""
        if self._shown is not None:
            from matplotlib import pyplot

            pyplot.close(self._shown)
            self._shown = None

    def _open(self) -> bool:
        """Open the window unless it is; false where there is none, or a person closed it."""
        import matplotlib
        from matplotlib import pyplot, style
        from matplotlib.backends.registry import backend_registry

        if self._shown is not None:
            return bool(pyplot.fignum_exists(self._shown.number))
        _, framework = backend_registry.resolve_backend(  # type: ignore[no-untyped-call]
            matplotlib.get_backend()
        )
        if framework is None:
            return False
        try:
            with style.context(["default", STYLE]):
                self._shown = pyplot.figure(figsize=SIZE)
        except ImportError:  # a window was asked for by name, and there is no display
            return False
        return True

    def _update(self, task: Task, context: Context, obs: NDArray[np.float32], gains: Gains) -> None:
        from matplotlib import style

        assert self._shown is not None and self._shown.canvas.manager is not None
        self._shown.clear()
        with style.context(["default", STYLE]):
            paint(self._shown, task, context, obs, gains)
            self._shown.canvas.draw()
        self._shown.canvas.manager.set_window_title(ENV_ID)
        self._shown.canvas.manager.show()
        self._shown.canvas.start_event_loop(HUMAN_PAUSE)
