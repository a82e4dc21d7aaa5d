"""How far a batch has come."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.row import Outcome, Row

BESIDE = 100_000
"""What a mesh takes besides its size, as bytes: work is judged by the bytes of the files."""


@dataclass(frozen=True)
class BatchState:
    """How far a batch has come, told whenever a mesh is begun or ended."""

    finished: int
    """Meshes that an earlier batch had finished."""
    stale: int
    """Of those to do, meshes whose labels of other settings are replaced."""
    labelled: int
    failed: int
    """Refused or lost."""
    left: int
    """Meshes without a row yet, those in work included."""
    share: float
    """Share of the work that is done, by the size of the files, from 0 to 1."""
    largest: MeshFile | None
    """The largest mesh in work."""
    row: Row | None = None
    """What came of the mesh that has just ended."""


Watch = Callable[[BatchState], None]


def unwatched(state: BatchState) -> None:
    """Tell nobody."""


@dataclass
class Books:
    """Counts what a batch has done, and tells of it."""

    meshes: Sequence[MeshFile]
    """What is to do."""
    finished: int
    stale: int
    watch: Watch
    _labelled: int = 0
    _failed: int = 0
    _work: int = 0
    _running: dict[str, MeshFile] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._whole = sum(mesh.size + BESIDE for mesh in self.meshes)
        self._tell(None)

    def begin(self, mesh: MeshFile) -> None:
        """A mesh is sent to be labelled."""
        self._running[mesh.name] = mesh
        self._tell(None)

    def end(self, row: Row) -> None:
        """A mesh has come back."""
        mesh = self._running.pop(row.mesh)
        self._work += mesh.size + BESIDE
        if row.outcome == Outcome.LABELLED:
            self._labelled += 1
        else:
            self._failed += 1
        self._tell(row)

    def _tell(self, row: Row | None) -> None:
        largest = max(self._running.values(), key=lambda mesh: mesh.size, default=None)
        self.watch(
            BatchState(
                finished=self.finished,
                stale=self.stale,
                labelled=self._labelled,
                failed=self._failed,
                left=len(self.meshes) - self._labelled - self._failed,
                share=self._work / self._whole if self._whole else 1.0,
                largest=largest,
                row=row,
            )
        )
