"""Rows: the results of one mesh each; this module alone declares their columns.

A column is a field of `Row` with its meaning, a function that returns its value for a labelled
surface, and the format that people read. Files, the printed table, the report and the docs use it.
"""

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, fields, replace
from enum import StrEnum
from functools import cached_property
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from grasp3d.system.names import short_number

if TYPE_CHECKING:
    from grasp3d.arrays import Floats
    from grasp3d.describe.verdict import Verdict
    from grasp3d.surface.labels import SurfaceLabels


PERCENTS = (10, 50, 90)
"""Levels of the quantiles over a surface."""


class Outcome(StrEnum):
    """Whether a mesh was labelled."""

    LABELLED = "labelled"
    REFUSED = "refused"
    """The mesh cannot be labelled; it is tried again only when it or the settings change."""
    LOST = "lost"
    """Its process died, or exceeded the time or memory limit; the next run tries it again."""


class Labelled:
    """A labelled surface, with values that several columns need."""

    def __init__(self, labels: "SurfaceLabels", *, judged: bool) -> None:
        """Take a surface; without `judged` there is no verdict, which may take long to compute."""
        self.labels, self._judged = labels, judged
        self._quantiles: dict[str, Floats | None] = {}

    @cached_property
    def fractions(self) -> dict[str, float]:
        """Area fractions of S, M and U."""
        return self.labels.fractions()

    @cached_property
    def verdict(self) -> "Verdict | None":
        """Whether the object is surely held."""
        from grasp3d.describe.verdict import verdict_of  # not needed for reading rows

        return verdict_of(self.labels) if self._judged else None

    @cached_property
    def causes(self) -> str:
        """Causes of U on parts of the surface."""
        from grasp3d.describe.explanations import causes_text

        return causes_text(self.labels)

    def quantile(self, name: str, percent: int) -> float | None:
        """Quantile of a column over the surface, by area; None: the labels lack the column."""
        if name not in self._quantiles:
            levels = [one / 100.0 for one in PERCENTS]
            self._quantiles[name] = self.labels.quantiles(name, levels)
        values = self._quantiles[name]
        return None if values is None else float(values[PERCENTS.index(percent)])

    def required_resolution(self, fraction: float) -> float:
        """Coarsest sensor resolution below which a fraction of the surface is S [rad]."""
        labels = self.labels
        available = replace(labels.model, sensor_resolution=0.0).sure_angle
        return max(0.0, 2.0 * (available - labels.angle_distribution().worst_quantile(fraction)))

    @property
    def held(self) -> float | None:
        """Area fraction whose grasps hold the load."""
        from grasp3d.surface.sweeps import label_fractions, vertex_weights

        found = self.labels.load_result
        if found is None or found.label is None:
            return None
        return label_fractions(found.label, vertex_weights(self.labels.mesh, "area"))["S"]

    @property
    def task(self) -> str | None:
        """The task that the grasps must resist."""
        from grasp3d.quality.loads import load_settings

        load = self.labels.load
        return None if load is None else str(load_settings(load)["task"])


@dataclass(frozen=True)
class Column:
    """Description of a field of a row, besides its name and type."""

    meaning: str
    of: Callable[[Labelled], Any] | None = None
    """Function that returns the value for a labelled surface; None: it is known without one."""
    heading: str = ""
    """Heading of the column in the report and the printed table; empty: it is not shown there."""
    unit: str = ""
    """Unit of the number that people read; 'unit': the unit of the mesh."""
    otherwise: str = "none"
    """Text instead of a number that is not finite."""

    def text(self, value: Any, row: "Row") -> str:
        """Format a value for people; empty if it is unknown."""
        if value is None or math.isnan(value):  # nan: motors must hold the load
            return ""
        if not math.isfinite(value):
            return self.otherwise
        if self.unit == "rad":
            return f"{math.degrees(value) + 0.0:.1f}°"  # never -0
        if self.unit == "%":
            return f"{100.0 * value:.0f} %"
        if isinstance(value, int):
            return f"{value:,}"
        return (
            f"{short_number(value)} {row.unit or '' if self.unit == 'unit' else self.unit}".strip()
        )


@dataclass(frozen=True)
class _Resolution(Column):
    """A required sensor resolution; 0: none is fine enough."""

    def text(self, value: Any, row: "Row") -> str:
        return super().text(value or math.inf if value is not None else None, row)


def _column(
    meaning: str, of: Callable[[Labelled], Any] | str | None = None, *,
    default: Any = None, kind: type[Column] = Column, **shown: Any,
) -> Any:  # fmt: skip
    """Declare a column; `of` may be the path of an attribute."""
    column = kind(meaning, attrgetter(of) if isinstance(of, str) else of, **shown)
    return field(default=default, metadata={"column": column})


_UNITS = {"critical_angle": "rad", "margin": "rad", "payload": "kg"}
"""Units of the columns that have quantiles; ε has none."""


def _quantile(meaning: str, name: str, percent: int, **shown: Any) -> Any:
    def of(one: Labelled) -> float | None:
        return one.quantile(name, percent)

    text = f"{percent} % quantile over the surface, by area, of {meaning}"
    return _column(text, of, **{"unit": _UNITS.get(name, "")} | shown)


def _required(percent: int, heading: str = "") -> Any:
    def of(one: Labelled) -> float:
        return one.required_resolution(percent / 100.0)

    return _column(
        f"coarsest sensor resolution below which {percent} % of the surface is S, with the "
        "friction and the other uncertainties as they are; 0: none is fine enough",
        of, kind=_Resolution, heading=heading, unit="rad",
    )  # fmt: skip


_ANGLE = (
    "the critical friction angle of the best grasp found at a contact point: the grasp is "
    "force-closed exactly when the friction angle β = atan μ exceeds β*; inf: no grasp found"
)
_MARGIN = (
    "the margin, by how much the friction angle exceeds what β* and all uncertainties need: S is "
    "where it is above 0; -inf: no grasp found"
)
_EPSILON = (
    "ε, the smallest disturbance wrench that the grasp cannot resist (Ferrari & Canny), relative "
    "to the fingers' force; 0: no grasp found"
)
_EPSILON_MIN = "the smallest ε over all normals that the sensor cannot tell apart"
_PAYLOAD = (
    "the largest mass that the grasp surely holds with the available force [kg]; 0: no grasp found"
)


def _of_verdict(*names: str) -> Callable[[Labelled], Any]:
    """Return a function for an attribute of the verdict, or None where an attribute is missing."""

    def of(one: Labelled) -> Any:
        found: Any = one.verdict
        for name in names:
            found = None if found is None else getattr(found, name)
        return found

    return of


def _known(of: Callable[[Labelled], Any]) -> Callable[[Labelled], float | None]:
    """Return a function that replaces numbers that are not finite by None."""

    def value(one: Labelled) -> float | None:
        number = of(one)
        return number if number is not None and math.isfinite(number) else None

    return value


@dataclass(frozen=True)
class BestGrasp:
    """One of the best distinct grasps of a mesh."""

    critical_angle: float
    """Critical friction angle over the worst normals [rad]."""
    max_resolution: float
    """Coarsest sensor resolution below which the grasp is S at the model's friction [rad]; 0: none
    is fine enough."""
    epsilon: float
    """Epsilon at the nominal normals."""
    opening: float
    """Largest distance between two contacts [m]."""
    points: tuple[tuple[float, float, float], ...]
    """Contact points, in the mesh's frame."""
    normals: tuple[tuple[float, float, float], ...]
    """Outward unit normals at the contact points."""
    label: str = ""
    """S, M or U, with everything that is stated."""
    score: float = 0.0
    """Number by which grasps are sorted, from 0 to 1."""
    pose: tuple[float, ...] = ()
    """With a gripper: the rows of the 4 x 4 matrix from its frame to the mesh's, 16 numbers."""
    approach_margin: float | None = None
    """Angle by which the approach may turn about the closing axis [rad]; None: no gripper."""
    grip_force: float | None = None
    """Force of each finger that holds it at the worst normals [N]; None: no load, or none does."""
    payload: float | None = None
    """Mass that it holds at the worst normals [kg]; None: no load, or no available force."""


@dataclass(frozen=True)
class Row:
    """The row of a mesh; values that are unknown, as for unlabelled meshes, are None."""

    mesh: str = _column("name: path below the input folder", default="")
    source: str = _column("path or address of the file, as given", default="")
    outcome: Outcome = _column(  # noqa: RUF009
        "labelled; refused: the mesh cannot be labelled; lost: its process died, or exceeded the "
        "limit of time or memory",
        default=Outcome.LABELLED,
    )
    error: str = _column("why the mesh was not labelled", default="")
    bytes: int | None = _column("size of the file")
    stamp: str = _column("state of the file: the same one means the same content", default="")
    content: str = _column("SHA-256 of the file, and of the files that it refers to", default="")
    key: str = _column(
        "SHA-256 of the content, the settings and the version of the method", default=""
    )
    friction_min: float | None = _column(
        "friction of the labels, the smallest where it is an interval",
        lambda one: one.labels.model.friction_interval[0],
    )
    friction_max: float | None = _column(
        "the same, the largest", lambda one: one.labels.model.friction_interval[1]
    )
    gripper: str | None = _column(
        "name of the gripper or hand that must reach the grasps; null: ideal points",
        lambda one: None if one.labels.scene is None else one.labels.scene.hand.name,
    )
    verdict: str | None = _column(
        "surely, perhaps or not held; null: no best grasps are asked for", _of_verdict("word")
    )
    verdict_text: str | None = _column(
        "the verdict in one to three sentences", lambda one: one.verdict and str(one.verdict)
    )
    causes: str | None = _column(
        "why parts of the surface are U, with their area fractions", "causes"
    )
    stable_grasps: int | None = _column(
        "distinct S grasps; with a gripper, that it reaches; counted up to 1,000",
        _of_verdict("count"),
    )
    spare_resolution: float | None = _column(
        "of the best grasp: α* − α; negative: a finer sensor is needed; null: none is fine enough",
        _known(_of_verdict("spare_resolution")), unit="rad",
    )  # fmt: skip
    task: str | None = _column(
        "what the grasps must resist; null, as all else on the load: there is none", "task"
    )
    mass: float | None = _column(
        "mass of the object; null: not given",
        lambda one: None if one.labels.load_case is None else one.labels.load_case.mass,
        unit="kg",
    )
    grip_force_available: float | None = _column(
        "available force of each finger; null: not given",
        lambda one: None if one.labels.load_case is None else one.labels.load_case.available,
        unit="N",
    )
    holds: bool | None = _column(
        "whether some grasp holds the load, at the worst normals, with the available force; null: "
        "mass or force not given",
        _of_verdict("load_result", "holds"),
    )
    surface: str = _column(
        "path of the labelled PLY below the output folder, or name of the NPZ in the .tar that is "
        "called like this file; empty: none is stored",
        default="",
    )
    thumbnail: str = _column(
        "path of the small picture; empty: none could be made, or the library is too large",
        default="",
    )
    page: str = _column(
        "path of the mesh's page in the report; empty: the library is too large", default=""
    )
    stable: float | None = _column("area fraction of S", lambda one: one.fractions["S"])
    ambiguous: float | None = _column("area fraction of M", lambda one: one.fractions["M"])
    no_grasp_found: float | None = _column("area fraction of U", lambda one: one.fractions["U"])
    critical_angle_p10: float | None = _quantile(_ANGLE, "critical_angle", 10)
    critical_angle_p50: float | None = _quantile(
        _ANGLE, "critical_angle", 50, heading="β* median", unit="rad", otherwise="no grasp"
    )
    critical_angle_p90: float | None = _quantile(_ANGLE, "critical_angle", 90)
    margin_p10: float | None = _quantile(_MARGIN, "margin", 10)
    margin_p50: float | None = _quantile(
        _MARGIN, "margin", 50, heading="Margin median", unit="rad", otherwise="no grasp"
    )
    margin_p90: float | None = _quantile(_MARGIN, "margin", 90)
    required_resolution_50: float | None = _required(50)
    required_resolution_80: float | None = _required(80, heading="α for 80 %")
    required_resolution_90: float | None = _required(90)
    epsilon_p10: float | None = _quantile(_EPSILON, "epsilon", 10)
    epsilon_p50: float | None = _quantile(_EPSILON, "epsilon", 50, heading="ε median")
    epsilon_p90: float | None = _quantile(_EPSILON, "epsilon", 90)
    epsilon_min_p10: float | None = _quantile(_EPSILON_MIN, "epsilon_min", 10)
    epsilon_min_p50: float | None = _quantile(_EPSILON_MIN, "epsilon_min", 50)
    epsilon_min_p90: float | None = _quantile(_EPSILON_MIN, "epsilon_min", 90)
    payload_best: float | None = _column(
        "largest mass that a grasp surely holds with the available force, for all true normals "
        "within the sensor resolution",
        _known(_of_verdict("load_result", "payload")), heading="Payload", unit="kg",
    )  # fmt: skip
    payload_p10: float | None = _quantile(_PAYLOAD, "payload", 10)
    payload_p50: float | None = _quantile(_PAYLOAD, "payload", 50)
    payload_p90: float | None = _quantile(_PAYLOAD, "payload", 90)
    grip_force_needed: float | None = _column(
        "smallest force of each finger that surely holds the load, or 1 kg where no mass is given; "
        "inf: none does",
        _of_verdict("load_result", "needed"), heading="Grip force", unit="N",
    )  # fmt: skip
    held: float | None = _column(
        "area fraction of the grasps that surely hold the load with the available force",
        "held", heading="Held", unit="%",
    )  # fmt: skip
    size: float | None = _column(
        "diameter of the surface's bounding sphere", "labels.mesh.size", heading="Size", unit="unit"
    )
    unit: str | None = _column(
        "unit of lengths: m; null where that of the mesh is not known", "labels.mesh.unit"
    )
    file_unit: str | None = _column(
        "unit of the file's coordinates, stated or guessed; null: not known",
        "labels.mesh.file_unit",
    )
    vertices: int | None = _column(
        "vertices of the refined surface", lambda one: len(one.labels.mesh.vertices),
        heading="Vertices",
    )  # fmt: skip
    faces: int | None = _column("faces of that surface", lambda one: len(one.labels.mesh.faces))
    closed: bool | None = _column(
        "whether the surface encloses a volume", "labels.mesh.report.closed"
    )
    area: float | None = _column("area of the surface", "labels.mesh.area", unit="unit²")
    volume: float | None = _column(
        "enclosed volume; null where the surface is open",
        _known(attrgetter("labels.mesh.volume")), unit="unit³",
    )  # fmt: skip
    center_mass: tuple[float, float, float] | None = _column(
        "centre of mass", lambda one: tuple(one.labels.mesh.center_mass.tolist()), unit="unit"
    )
    torque_scale: float | None = _column(
        "length by which torques are divided in ε", "labels.mesh.torque_scale", unit="unit"
    )
    grasps: tuple[BestGrasp, ...] = _column(
        "best distinct grasps, the best first, see below", default=()
    )
    search_angle: float | None = _column(
        "half-angle of the cone that was searched", "labels.search.cone", unit="rad"
    )
    repairs: str = _column(
        "what was repaired", lambda one: "; ".join(map(str, one.labels.mesh.report.repairs)),
        default="",
    )  # fmt: skip
    warnings: str = _column(
        "warnings about the mesh and its lengths", lambda one: "; ".join(one.labels.warnings),
        default="",
    )  # fmt: skip
    seconds_reading: float | None = _column("time for reading the mesh [s]")
    seconds_labelling: float | None = _column("time for search, labels and ε [s]")
    seconds_writing: float | None = _column("time for best grasps, files and pictures [s]")
    seconds: float = _column("time for the mesh [s]", default=0.0, heading="Seconds")

    def of(self, labels: "SurfaceLabels", *, judged: bool = True) -> "Row":
        """Return this row with the values of a labelled surface."""
        one = Labelled(labels, judged=judged)
        values = {name: column.of(one) for name, column in COLUMNS.items() if column.of}
        return replace(self, **values)

    def text(self, name: str) -> str:
        """Format the value of a column for people; empty if there is none."""
        return COLUMNS[name].text(getattr(self, name), self)


COLUMNS: dict[str, Column] = {one.name: one.metadata["column"] for one in fields(Row)}
"""All columns, by name."""


def headed(rows: Iterable[Row]) -> dict[str, Column]:
    """Return the columns that people read, without those that have no value for any mesh."""
    labelled = [row for row in rows if row.outcome is Outcome.LABELLED]
    return {
        name: column
        for name, column in COLUMNS.items()
        if column.heading and any(row.text(name) for row in labelled)
    }
