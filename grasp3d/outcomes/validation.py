"""Result, table and figure of the comparison of labels and scores with outcomes.

Each score has a direction in which it counts, and a number for how well it ranks grasps that held
above grasps that failed. The directions follow from mechanics and are the same for all data; none
is chosen from outcomes.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from matplotlib.figure import Figure
from scipy.special import expit, logit
from scipy.stats import rankdata, t

from grasp3d.arrays import Bools, Floats, Ints, angles_between, short_repr
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.outcomes.success import LEVEL, SuccessRate, success_rate
from grasp3d.pictures.figures import LABEL_COLORS, LINES, PAGE, new_figure, styled
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.surface.fields import Array, under_load


def roc_auc(held: Bools, scores: Floats, clusters: Ints) -> tuple[float, float, float]:
    """Compute the area under the ROC curve, with its interval at 95 %.

    The area is the probability that a grasp that held has a better score than one that failed;
    equal scores count half (Mann & Whitney 1947). Its variance is that of DeLong et al. 1988. Where
    grasps come in clusters, such as those on one object, it is that of Obuchowski 1997: grasps of a
    cluster are alike, so only several clusters show how much areas differ. The interval is that of
    Student's t in the logit of the area.

    Args:
        held: Whether each grasp held, shape (n,).
        scores: Larger is better; -inf is the worst, nan is not allowed; shape (n,).
        clusters: Number of the cluster of each grasp, from 0, shape (n,); `arange(n)`: no clusters.

    Returns:
        Area and both ends of the interval; nan where all outcomes are the same. The ends are 0 and
        1 where an outcome occurs in a single cluster, and equal the area where it is 0 or 1.

    Example:
        Two of three grasps that held have a better score than both that failed:

        >>> import numpy as np
        >>> from grasp3d.outcomes.validation import roc_auc
        >>> held = np.array([True, True, False, True, False])
        >>> area, low, high = roc_auc(held, np.array([0.9, 0.8, 0.7, 0.6, 0.5]), np.arange(5))
        >>> round(area, 4)
        0.8333
    """
    kinds = [held, ~held]
    if not all(kind.any() for kind in kinds):
        return math.nan, math.nan, math.nan
    # Scores that differ by rounding, as for symmetric grasps, are equal in single precision.
    compared = scores.astype(np.float32)
    below = rankdata(compared)  # how many of the other outcome are worse; equal ones count half
    for kind in kinds:
        below[kind] -= rankdata(compared[kind])
    shares = [below[held] / kinds[1].sum(), 1.0 - below[~held] / kinds[0].sum()]
    area = float(shares[0].mean())
    counts = [len(np.unique(clusters[kind])) for kind in kinds]
    if area in (0.0, 1.0):
        return area, area, area
    if min(counts) == 1:
        return area, 0.0, 1.0
    every, most = len(np.unique(clusters)), int(clusters.max()) + 1
    parts = [np.bincount(clusters[kind], share - area, most) / len(share)
             for kind, share in zip(kinds, shares, strict=True)]  # fmt: skip
    own = (n / (n - 1) * float(part @ part) for part, n in zip(parts, counts, strict=True))
    variance = sum(own) + 2.0 * every / (every - 1) * float(parts[0] @ parts[1])
    spread = float(t.ppf(0.5 + 0.5 * LEVEL, min(counts) - 1)) * math.sqrt(max(variance, 0.0))
    low, high = expit(logit(area) + np.array([-1.0, 1.0]) * spread / (area * (1.0 - area))).tolist()
    return area, low, high


def roc_curve(held: Bools, scores: Floats) -> tuple[Floats, Floats]:
    """Fractions of failed and of held grasps that thresholds accept, from none to all.

    Args:
        held: Whether each grasp held, shape (n,); both outcomes occur.
        scores: As for `roc_auc`.

    Returns:
        Both of shape (m + 1,), for m distinct scores.
    """
    _, group = np.unique(-scores.astype(np.float32), return_inverse=True)
    failed, right = (
        np.append(0.0, np.cumsum(np.bincount(group, kind))) / kind.sum() for kind in (~held, held)
    )
    return failed, right


Of = Callable[[EvaluatedPoses], Array | None]
"""Function that returns values of evaluated poses in SI units, shape (k,); None: they need
something unknown, such as a load."""


@dataclass(frozen=True)
class Score:
    """A number of each grasp that may predict whether it holds.

    Example:
        >>> from grasp3d.outcomes import SCORES
        >>> print(*(score.name for score in SCORES))
        quality score payload margin critical_angle label epsilon ...
    """

    name: str
    """Name of its column in tables."""
    title: str
    better: Literal["larger", "smaller"]
    """Which values are better; fixed beforehand."""
    of: Of = field(repr=False)
    """Function that computes it from evaluated poses."""
    always: bool = False
    """Whether it has a value where the hand does not close on the object."""

    def ranked(self, values: Floats) -> Floats:
        """Values turned so that larger is better; -inf, the worst, where one is missing (nan)."""
        signed = values if self.better == "larger" else -values
        return np.where(np.isnan(signed), -math.inf, signed)


def _of_jaws(of: Callable[[Any], Array]) -> Of:
    """Restrict a function to poses of grippers; it returns None for hands with joints."""
    return lambda poses: of(poses) if hasattr(poses, "jaws") else None


def _line(poses: JawGrasps) -> Floats:
    """Unit vectors from the first contact to the second, shape (k, 3)."""
    line = poses.jaws.points[:, 1] - poses.jaws.points[:, 0]
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(line / np.linalg.norm(line, axis=1, keepdims=True))


def _antipodal_angle(poses: JawGrasps) -> Floats:
    line, normals = _line(poses), poses.jaws.normals
    with np.errstate(invalid="ignore"):
        return np.maximum(angles_between(normals[:, 0], line), angles_between(normals[:, 1], -line))


def _normal_product(poses: JawGrasps) -> Floats:
    return np.asarray(poses.jaws.normals.prod(axis=1).sum(axis=1))


def _arm(poses: JawGrasps) -> Floats:
    away = np.cross(poses.mesh.center_mass - poses.jaws.points[:, 0], _line(poses))
    return np.asarray(np.linalg.norm(away, axis=1))


SCORES = (
    Score("quality", "quality", "larger", attrgetter("quality"), always=True),
    Score("score", "score", "larger", attrgetter("score"), always=True),
    Score("payload", "payload", "larger", under_load("payload")),
    Score("margin", "margin", "larger", attrgetter("margin")),
    Score("critical_angle", "β*", "smaller", attrgetter("critical_angle")),
    Score("label", "label", "larger", attrgetter("label"), always=True),
    Score("epsilon", "ε", "larger", attrgetter("epsilon")),
    Score("grip_force", "grip force", "smaller", under_load("grip_force")),
    Score("reachable", "reachable", "larger", attrgetter("reachable"), always=True),
    Score("antipodal_angle", "antipodal angle", "smaller", _of_jaws(_antipodal_angle)),
    Score("normal_product", "product of the normals", "smaller", _of_jaws(_normal_product)),
    Score("center_of_mass_distance", "distance of the COM", "smaller", _of_jaws(_arm)),
    # A narrower grasp leaves the fingers more clearance on their way.
    Score("opening", "opening", "smaller", _of_jaws(attrgetter("opening"))),
    Score(
        "contact_area",
        "contact area",
        "larger",
        _of_jaws(lambda poses: poses.jaws.area.min(axis=1)),
    ),
)
"""All scores, each with its function."""


def scores_of(poses: EvaluatedPoses) -> dict[str, Floats]:
    """Compute the scores of evaluated poses, shape (k,) each, in SI units and radians.

    Args:
        poses: Evaluated poses.

    Returns:
        The scores by name of `SCORES`; nan where the hand does not close, except for scores that
        are always defined. Scores that need an unknown load or force, or jaws, are absent.
    """
    closed = poses.closed
    found = ((score, score.of(poses)) for score in SCORES)
    return {
        score.name: np.where(closed | score.always, values.astype(np.float64), math.nan)
        for score, values in found
        if values is not None
    }


def columns_of(poses: EvaluatedPoses) -> dict[str, Array]:
    """Return all results and scores of evaluated poses as columns of shape (k,).

    Args:
        poses: Evaluated poses.
    """
    table, scores = poses.to_table(), scores_of(poses)
    results = zip(table.column_names, table.columns, strict=True)
    # The table has labels as letters, and `reachable` as true or false.
    own = {name: scores[name] for name in scores if name not in {"label", "reachable"}}
    return {name: column.to_numpy() for name, column in results} | own


@dataclass(frozen=True)
class ValidatedFile:
    """Settings with which the grasps of one file were evaluated."""

    name: str
    object_number: int
    """Number of its object, from 1; files with the same mesh and scale have one object."""
    model: GraspModel
    """Friction and resolution for labels, margins and epsilon; its gripper may state its own."""
    count: int
    """Number of grasps with an outcome."""
    not_tried: int
    """Number of grasps without an outcome, which are left out."""
    sources: str
    """Gripper, mass and centre of mass with their origins, in words."""


@dataclass(frozen=True)
class ScoreQuality:
    """How well one score ranks grasps that held above grasps that failed."""

    score: Score
    roc_auc: float
    """Probability that a held grasp ranks above a failed one; nan if all outcomes are the same."""
    low: float
    """Lower end of its interval at 95 %: for other objects if there are several, else for other
    grasps of this one."""
    high: float
    """Upper end of this interval."""


@dataclass(frozen=True, eq=False)
class Validation:
    """Comparison of the labels and scores of n grasps with their outcomes.

    Grasps whose jaws do not close on the mesh take part, as that is a prediction too: they are
    labelled U and have the worst value of every score.
    """

    files: tuple[ValidatedFile, ...]
    columns: Mapping[str, npt.NDArray[Any]]
    """`file`, `object` (number, from 1), `grasp` (number in the file, from 1), `mass` [kg], all
    results of `EvaluatedPoses.to_table`, `outcome` among them, and `SCORES`, in SI units and in the
    order of the files; shape (n,) each."""
    qualities: tuple[ScoreQuality, ...]
    """Quality of each score."""
    warnings: tuple[str, ...]
    """Reasons why the results may be wrong, one sentence each."""
    outcome: str | None = None
    """Name of the values in the files that are the outcomes; None: those of their formats."""

    __repr__ = short_repr

    @property
    def size(self) -> int:
        """Number of grasps with an outcome."""
        return len(self.held)

    @property
    def objects(self) -> int:
        """Number of objects."""
        return len({one.object_number for one in self.files})

    @property
    def held(self) -> Bools:
        """Whether each grasp held, shape (n,)."""
        return np.asarray(self.columns["outcome"] == 1.0)

    @property
    def rates(self) -> dict[Label, SuccessRate]:
        """Success rate of the grasps with each label, S first."""
        return {
            label: success_rate(label.name, self.held[self.columns["label"] == label.name])
            for label in sorted(Label)[::-1]
        }

    @property
    def wrong(self) -> Ints:
        """Rows of S that failed, best score first, then of U that held, worst score first."""
        label, score = self.columns["label"], self.columns["score"]
        failed = np.flatnonzero(~self.held & (label == "S"))
        held = np.flatnonzero(self.held & (label == "U"))
        return np.concatenate([failed[np.argsort(-score[failed])], held[np.argsort(score[held])]])

    def ranked(self, score: Score) -> Floats:
        """Values of a score, shape (n,), turned so that larger is better; -inf if missing.

        Args:
            score: A score that was computed.
        """
        values = self.columns[score.name]
        if score.name == "label":
            values = np.array([Label[letter] for letter in values.tolist()])
        return score.ranked(values.astype(np.float64))

    def quality(self, name: str) -> ScoreQuality:
        """How well a score ranks held grasps above failed ones.

        Args:
            name: Name of the score.

        Raises:
            KeyError: The score was not computed.
        """
        return {one.score.name: one for one in self.qualities}[name]


def write_validation(path: str | Path, result: Validation) -> None:
    """Write a table with a row for each grasp: outcome, scores, and all results.

    Angles are in radians, lengths in metres, areas in square metres, forces in newtons, masses in
    kilograms; nan leaves the cell empty.

    Args:
        path: Table to create or replace, .csv or .parquet.
        result: The outcome of `validate_grasps`.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.formats import GraspPoses
        >>> from grasp3d.outcomes import write_validation
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
        >>> tried = GraspPoses(poses=poses, outcome=[1, 0], unit="m")
        >>> franka = grasp3d.ParallelGripper.preset("franka")
        >>> write_validation("out.csv", grasp3d.validate_grasps(tried, mesh=box, hand=franka))
        >>> print(Path("out.csv").read_text()[:23])
        "file","object","grasp"
    """
    from grasp3d.system.tables import write_columns

    write_columns(Path(path), result.columns, settings={})


SHOWN = ("quality", "margin", "payload", "epsilon", "contact_area")
"""Scores whose ROC curves are drawn, if known."""

LINE = "#222222"


@styled
def validation_figure(result: Validation) -> Figure:
    """Draw success rates of S, M and U with intervals, and ROC curves if both outcomes occur.

    Args:
        result: The result.
    """
    figure = new_figure(PAGE, 2.8)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.6))
    shown = {label: rate for label, rate in result.rates.items() if rate.count}
    for place, (label, rate) in enumerate(shown.items()):
        spread = np.abs(np.array(rate.interval) - rate.rate)[:, None]
        left.errorbar([place], [rate.rate], spread, fmt="o", color=LABEL_COLORS[label],
                      markeredgecolor=LINE, markeredgewidth=0.5, ecolor=LINE, elinewidth=0.7,
                      capsize=2.0, markersize=6.0)  # fmt: skip
    dotted: dict[str, Any] = {"color": LINE, "linewidth": 0.7, "linestyle": ":"}
    left.axhline(result.held.mean(), label=f"all grasps {result.held.mean():.2f}", **dotted)
    left.set_xticks(range(len(shown)), [f"{of.name}\n{of.count:,}" for of in shown.values()])
    left.set(xlim=(-0.5, len(shown) - 0.5), ylim=(-0.02, 1.02), xlabel="label, number of grasps",
             ylabel="fraction that held")  # fmt: skip
    left.legend()
    curves = [one for one in result.qualities if one.score.name in SHOWN]
    for one, line in zip(curves, LINES, strict=False):
        if not np.isnan(one.roc_auc):
            values = result.ranked(one.score)
            title = f"{one.score.title} {one.roc_auc:.2f}"
            right.plot(*roc_curve(result.held, values), label=title, **line)
    right.plot([0.0, 1.0], [0.0, 1.0], label="chance 0.50", **dotted)
    right.set(xlim=(0.0, 1.0), ylim=(0.0, 1.01), aspect="equal",
              xlabel="accepted fraction of the failed grasps",
              ylabel="accepted fraction of the held grasps")  # fmt: skip
    right.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), title="area under the curve")
    return figure
