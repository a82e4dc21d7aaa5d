"""Progress of a batch: counts of meshes, and the amount of work that is done."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field

from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.row import Outcome, Row

BYTES_PER_MESH = 100_000
"""Bytes added to the size of each file: the work for a mesh is estimated by the bytes of its
file."""


@dataclass(frozen=True)
class BatchProgress:
    """Progress of a batch, reported whenever a mesh is started or finished."""

    finished: int
    """Meshes that an earlier batch had finished."""
    stale: int
    """Meshes of this batch whose labels of other settings are replaced."""
    labelled: int
    failed: int
    """Refused or lost."""
    left: int
    """Meshes without a row yet, including the running ones."""
    fraction: float
    """Fraction of the work that is done, estimated by the size of the files, from 0 to 1."""
    largest: MeshFile | None
    """The largest running mesh."""
    row: Row | None = None
    """Row of the mesh that has just finished."""


ProgressCallback = Callable[[BatchProgress], None]


def ignore_progress(progress: BatchProgress) -> None:
    """Do nothing with the progress of a batch."""


@dataclass
class ProgressCounter:
    """Counts what a batch has done, and reports it."""

    meshes: Sequence[MeshFile]
    """Meshes to label."""
    finished: int
    stale: int
    report: ProgressCallback
    _labelled: int = 0
    _failed: int = 0
    _work_done: int = 0
    _running: dict[str, MeshFile] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self._total_work = sum(mesh.size + BYTES_PER_MESH for mesh in self.meshes)
        self._report(None)

    def start(self, mesh: MeshFile) -> None:
        """Count a mesh that is sent to a worker."""
        self._running[mesh.name] = mesh
        self._report(None)

    def finish(self, row: Row) -> None:
        """Count a mesh that has got a row."""
        mesh = self._running.pop(row.mesh)
        self._work_done += mesh.size + BYTES_PER_MESH
        if row.outcome == Outcome.LABELLED:
            self._labelled += 1
        else:
            self._failed += 1
        self._report(row)

    def _report(self, row: Row | None) -> None:
        largest = max(self._running.values(), key=lambda mesh: mesh.size, default=None)
        self.report(
            BatchProgress(
                finished=self.finished,
                stale=self.stale,
                labelled=self._labelled,
                failed=self._failed,
                left=len(self.meshes) - self._labelled - self._failed,
                fraction=self._work_done / self._total_work if self._total_work else 1.0,
                largest=largest,
                row=row,
            )
        )
