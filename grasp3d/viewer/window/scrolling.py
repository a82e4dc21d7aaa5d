"""Scrolling of a panel's rows: the visible part, and the thumb of the scroll bar."""

SHORTEST_THUMB = 28.0
"""Shortest length of the thumb [pixels]."""


class Scroll:
    """How far the rows of a panel are scrolled; lengths are in pixels, downward."""

    def __init__(self) -> None:
        self.offset = 0.0
        """Height of what is above the visible part."""
        self.view = 0.0
        """Height of the visible part."""
        self._whole = 0.0
        self._grabbed = 0.0

    @property
    def needed(self) -> bool:
        """Whether there is more than is visible, or was when rows were scrolled."""
        return self._whole > self.view or self.offset > 0.0

    @property
    def thumb(self) -> tuple[float, float]:
        """Upper and lower end of the scroll bar's thumb."""
        length = max(SHORTEST_THUMB, self.view * self.view / max(self._whole, self.view))
        start = (self.view - length) * min(1.0, self.offset / max(self._last, 1.0))
        return start, start + length

    def fit(self, whole: float, view: float, *, held: bool) -> None:
        """Adapt to other heights of all rows and of the visible part.

        Args:
            whole: Height of all rows.
            view: Height of the visible part.
            held: Whether the mouse button is pressed: then rows must not move.
        """
        self._whole, self.view = whole, max(view, 1.0)
        if not held:
            self.offset = min(self.offset, self._last)

    def move(self, by: float) -> bool:
        """Scroll by a height; returns whether that has changed anything."""
        before, self.offset = self.offset, min(max(0.0, self.offset + by), self._last)
        return self.offset != before

    def reveal(self, top: float, bottom: float) -> None:
        """Scroll as little as is needed to see some rows, at least their beginning."""
        if bottom > self.offset + self.view:
            self.offset = bottom - self.view
        self.offset = max(0.0, min(self.offset, top, self._last))

    def grab(self, y: float) -> None:
        """Begin to drag the thumb; a press beside it moves it there."""
        start, end = self.thumb
        if not start <= y <= end:
            self._grabbed = 0.5 * (end - start)
            self.drag(y)
        else:
            self._grabbed = y - start

    def drag(self, y: float) -> bool:
        """Drag the thumb; returns whether that has changed anything."""
        start, end = self.thumb
        track = max(self.view - (end - start), 1.0)
        return self.move((y - self._grabbed) / track * self._last - self.offset)

    @property
    def _last(self) -> float:
        return max(0.0, self._whole - self.view)
