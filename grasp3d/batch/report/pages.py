"""Writing the report: a page with a table of all meshes, their pictures and their files."""

import math
from collections import Counter
from collections.abc import Callable, Collection
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.resources import files
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, StrictUndefined

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.quality.loads import load_settings
from grasp3d.settings.model_text import SAFE_LABELS
from grasp3d.settings.parsing import plain_values
from grasp3d.stability.label import COLORS
from grasp3d.system.counts import counted, short_number
from grasp3d.system.names import printable
from grasp3d.system.versions import package_version

REPORT = "report/index.html"
"""Path of the page below the output folder."""

TEMPLATE = "page.html"


@dataclass(frozen=True)
class Column:
    """A column of numbers; left out where no mesh has one."""

    title: str
    meaning: str
    text: Callable[[Row], str]
    """The number of a labelled mesh; empty where it has none."""


def _angle(row: Row, name: str, otherwise: str) -> str:
    """An angle in degrees; `otherwise`, where no grasp or no sensor reaches it."""
    angle = getattr(row, name)
    if angle is None:
        return ""
    reached = math.isfinite(angle) and (angle > 0.0 or name != "required_resolution_80")
    return f"{math.degrees(angle):.1f}°" if reached else otherwise


def _number(value: float | None, unit: str | None = None) -> str:
    if value is None:
        return ""
    return f"{short_number(value)} {unit or ''}".rstrip() if math.isfinite(value) else "none"


def _percent(fraction: float | None) -> str:
    return "" if fraction is None else f"{100.0 * fraction:.0f} %"


COLUMNS = (
    Column(
        "β* median",
        "median over the surface, weighted by area, of the critical friction angle of the best "
        "grasp found at a contact point: the grasp is force-closed exactly when the friction angle "
        "β = atan μ exceeds β*",
        lambda row: _angle(row, "critical_angle_p50", "no grasp"),
    ),
    Column(
        "Margin median",
        "by how much the friction angle exceeds what β* and all uncertainties need: S is where it "
        "is above 0",
        lambda row: _angle(row, "margin_p50", "no grasp"),
    ),
    Column(
        "α for 80 %",
        "coarsest sensor resolution below which 80 % of the surface is S, with the friction and "
        "the other uncertainties as they are; none: no sensor resolution is fine enough",
        lambda row: _angle(row, "required_resolution_80", "none"),
    ),
    Column(
        "ε median",
        "smallest disturbance wrench that the grasp cannot resist (Ferrari & Canny), relative to "
        "the fingers' force; 0 without a grasp",
        lambda row: _number(row.epsilon_p50),
    ),
    Column(
        "Payload",
        "largest mass that a grasp surely holds with the force at hand, whatever the true normals "
        "are within the sensor resolution",
        lambda row: _number(row.payload_best, "kg"),
    ),
    Column(
        "Grip force",
        "smallest force of each finger that surely holds the load, or 1 kg where no mass is given",
        lambda row: _number(row.grip_force_needed, "N"),
    ),
    Column(
        "Held",
        "area fraction of the grasps that surely hold the load with the force at hand",
        lambda row: _percent(row.held),
    ),
    Column(
        "Size",
        "diameter of the surface's bounding sphere",
        lambda row: _number(row.size, row.unit),
    ),
    Column(
        "Vertices",
        "vertices of the refined surface",
        lambda row: "" if row.vertices is None else f"{row.vertices:,}",
    ),
    Column("Seconds", "time for the mesh", lambda row: _number(row.seconds)),
)


def write_report(output: Folder, rows: Collection[Row], settings: BatchSettings) -> None:
    """Write the page of a library, whose thumbnails are written already.

    Args:
        output: Folder of the results; the page goes to `report` below it.
        rows: All meshes, in the order of the table.
        settings: Settings of the labels.

    Raises:
        OutputError: A file cannot be written.
    """
    environment = Environment(autoescape=True, finalize=printable, undefined=StrictUndefined)
    template = files(__package__).joinpath(TEMPLATE).read_text(encoding="utf-8")
    counts = Counter(row.outcome for row in rows)
    labelled = [row for row in rows if row.outcome is Outcome.LABELLED]
    page = environment.from_string(template).render(
        rows=rows,
        columns=[column for column in COLUMNS if any(map(column.text, labelled))],
        address=_address,
        percent=_percent,
        counts=[(f"{counts[outcome]:,}", outcome) for outcome in Outcome],
        verdicts=any(row.verdict for row in rows),
        settings=_plain(settings),
        certainty=SAFE_LABELS if settings.model.location_error != 0.0 else "",
        colors={label.name: "#{:02x}{:02x}{:02x}".format(*rgb) for label, rgb in COLORS.items()},
        meshes=counted(len(rows), "meshes"),
        made=datetime.now(UTC).strftime("%Y-%m-%d %H:%M UTC"),
        version=package_version(),
    )
    output.write(REPORT, page.encode("utf-8"))


def _plain(settings: BatchSettings) -> dict[str, str]:
    """The settings as labelled files hold them."""
    hand = settings.reach.hand
    reach = {} if hand is None else plain_values(settings.reach) | {"hand": hand.name}
    load = {} if settings.load is None else load_settings(settings.load)
    values: dict[str, Any] = {
        **plain_values(settings.model),
        **plain_values(settings.sampling),
        **reach,
        **load,
        **plain_values(settings.mesh),
    }
    return {name: str(value) for name, value in values.items()}


def _address(path: str) -> str:
    """Address of a file below the output folder, from the page."""
    return f"../{quote(path)}"
