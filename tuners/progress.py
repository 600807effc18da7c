"""Progress bars, which commands show, and trainings of slow plants."""

from types import TracebackType
from typing import Any, Self

from tqdm import tqdm


class Bars:
    """One bar a stage; call with what is being done, how far it is, and how far it goes."""

    def __init__(self) -> None:
        self._bar: tqdm[Any] | None = None

    def __call__(self, what: str, done: int, of: int) -> None:
        """Show the progress of a stage; another stage starts another bar.

        A stage that ends early gives `of` equal to `done`, which fills its bar.
        """
        if self._bar is None or self._bar.desc != what:
            self.close()
            self._bar = tqdm(total=of, initial=done, desc=what, ncols=88)
        self._bar.total = of
        self._bar.update(done - self._bar.n)

    def close(self) -> None:
        """Finish the bar of the present stage."""
        if self._bar is not None:
            self._bar.close()
            self._bar = None

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        value: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self.close()
