"""Why poses are no grasps, or no sure ones: one sentence for each."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bools, Ints


class Reasons:
    """Sentences on poses; of each the first one that was added.

    Args:
        count: Number of poses.
    """

    def __init__(self, count: int) -> None:
        self._texts = [""] * count
        self.kinds = [""] * count
        """What the sentences are about, to count them."""

    @property
    def texts(self) -> npt.NDArray[np.str_]:
        """A sentence for each pose, shape (k,); empty: none."""
        return np.array(self._texts, dtype=np.str_)

    def without(self, chosen: Bools) -> Ints:
        """Rows of those of some poses (k,) that have no sentence yet."""
        return np.flatnonzero(chosen & (self.texts == ""))

    def add(self, kind: str, wrong: Bools | Ints, texts: Sequence[str] = ()) -> None:
        """Add sentences.

        Args:
            kind: What they are about.
            wrong: Of which poses: shape (k,), or their rows.
            texts: One for each of these; empty: `kind`.
        """
        rows = np.flatnonzero(wrong) if wrong.dtype == np.bool_ else wrong
        for number, row in enumerate(rows.tolist()):
            if not self._texts[row]:
                self._texts[row], self.kinds[row] = texts[number] if texts else kind, kind

    @staticmethod
    def length(length: float) -> str:
        """A length [m] in millimetres, with two digits below 10."""
        millimetres = 1000.0 * float(length)
        return f"{millimetres:.2g} mm" if millimetres < 10.0 else f"{millimetres:.0f} mm"
