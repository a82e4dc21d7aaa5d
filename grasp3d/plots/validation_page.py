"""The report of a validation: one web page that needs no other file and no network."""

import base64
import io
import math
from collections.abc import Iterable, Sequence
from html import escape
from importlib.resources import files
from pathlib import Path
from string import Template

from matplotlib.figure import Figure
from PIL import Image

from grasp3d.arrays import Bytes
from grasp3d.plots.figures import as_svg
from grasp3d.plots.validations import (
    calibration_figure,
    draw_disagreement,
    label_figure,
    roc_figure,
)
from grasp3d.rendering.opengl import can_render
from grasp3d.stability.label import Label
from grasp3d.system.context import report_progress
from grasp3d.system.counts import counted
from grasp3d.system.files import atomic_write
from grasp3d.system.names import as_unicode, printable
from grasp3d.system.versions import package_version
from grasp3d.validating import sentences, text_tables
from grasp3d.validating.disagreements import MEANING as KINDS
from grasp3d.validating.disagreements import Disagreement
from grasp3d.validating.qualities import mean_over_objects
from grasp3d.validating.scores import Score
from grasp3d.validating.text_tables import number
from grasp3d.validating.validation import TABLES, Validation, made_folder, write_validation

PAGE = "report.html"
FILES = (PAGE, *TABLES)
"""Names of all files of a report."""

NO_PICTURES = "There are no pictures of them: they need OpenGL, which is not available here."


QUALITY = 85
"""Quality of the pictures' compression, from 0 to 100."""

TEMPLATE = "validation.html"
"""The page without a result; it loads nothing but what is in it, and no scripts at all."""


def write_report(folder: str | Path, result: Validation) -> None:
    """Write a validation as a web page and as tables (see `write_validation`).

    The page contains its figures and pictures; without OpenGL it says that pictures are missing.

    Args:
        folder: Folder to make or to write to; a report that is in it is replaced.
        result: The result.

    Raises:
        OutputError: A file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import GraspPoses
        >>> from grasp3d.plots.validation_page import write_report
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.06, 0.04, 0.02]), unit="m")
        >>> poses = np.tile(np.diag([1.0, -1.0, -1.0, 1.0]), (2, 1, 1))
        >>> poses[1, 1, 3] = 0.1
        >>> tried = GraspPoses(poses=poses, outcome=[1, 0], unit="m")
        >>> franka = grasp3d.ParallelGripper.preset("franka")
        >>> write_report("report", grasp3d.validate_grasps(tried, mesh=box, hand=franka))
        >>> sorted(path.name for path in Path("report").iterdir())
        ['calibration.csv', 'differences.csv', 'grasps.csv', 'labels.csv', 'objects.csv', ...]
    """
    folder = made_folder(folder)
    html = page_of(result)
    write_validation(folder, result)
    with atomic_write(folder / PAGE) as part:
        part.write_text(html, encoding="utf-8")


def page_of(result: Validation) -> str:
    """The page as HTML.

    Args:
        result: The result.
    """
    pictures = _pictures(result.disagreements)
    parts = {
        "summary": _summary(result),
        "scores": _scores(result),
        "labels": _labels(result),
        "calibration": _calibration(result),
        "disagreements": _disagreements(result, pictures),
        "files": [_files(result)],
        "version": [package_version()],
        "tables": [", ".join(TABLES)],
    }
    page = files(__package__).joinpath("static", TEMPLATE).read_text(encoding="utf-8")
    return Template(page).substitute({name: "\n".join(part) for name, part in parts.items()})


def _summary(result: Validation) -> list[str]:
    lines = [
        sentences.counts_of(result),
        sentences.model_of(result),
        *sentences.sources_of(result),
        sentences.closing_of(result),
    ]
    return [bullets(lines), *(f'<p class="warning">{text(line)}</p>' for line in result.warnings)]


def _scores(result: Validation) -> list[str]:
    (*heads,), rows = text_tables.scores_of(result)
    rows = [[*row, one.score.meaning] for row, one in zip(rows, result.qualities, strict=True)]
    rate = float(result.grasps.held.mean())
    note = (
        f"{sentences.intervals_of(result)}. Without information a score has a ROC-AUC of 0.5 and "
        f"an average precision of {rate:.3f}. Which values are better is fixed beforehand."
    )
    figure = [] if result.grasps.one_sided else [figure_tag(roc_figure(result), "ROC curves")]
    return [
        table([*heads, "meaning"], rows, texts=(1, len(heads))),
        f'<p class="quiet">{text(note)}</p>',
        *figure,
        *_differences(result),
        *_objects(result),
    ]


def _differences(result: Validation) -> list[str]:
    """The first score against all others, and every two, folded."""
    if result.grasps.one_sided:
        return []
    note = (
        "Paired: the scores share the resamples. p: probability that a difference as large, either "
        f"way, is chance; at least {2.0 / (result.resamples + 1):.2g} with so many resamples."
    )
    return [
        table(*text_tables.differences_of(result)),
        f'<p class="quiet">{text(note)}</p>',
        "<details><summary>Every two scores</summary>",
        table(*text_tables.differences_of(result, every=True)),
        "</details>",
    ]


def _objects(result: Validation) -> list[str]:
    """ROC-AUC on each of several objects, their mean, and that of all grasps."""
    if not result.by_object:
        return []
    scores = [one.score for one in result.qualities]
    rows = [
        [
            result.object_names[one.number],
            f"{one.count:,}",
            f"{one.held:,}",
            *(number(one.roc_auc[score.name]) for score in scores),
        ]
        for one in result.by_objects
    ]
    means = (number(mean_over_objects(result.by_objects, score.name)) for score in scores)
    held = f"{int(result.grasps.held.sum()):,}"
    rows.append(["mean over objects", "", "", *means])
    rows.append(["all grasps", f"{result.grasps.size:,}", held,
                 *(number(one.roc_auc) for one in result.qualities)])  # fmt: skip
    heads = ["ROC-AUC", "grasps", "held", *(score.title for score in scores)]
    return ["<h3>By object</h3>", bullets(sentences.objects_of(result)), table(heads, rows)]


def _labels(result: Validation) -> list[str]:
    heads, rows = text_tables.labels_of(result)
    ordered = ("yes" if one.is_ordered else "no" for one in result.labels)
    cells = [[*row, word] for row, word in zip(rows, ordered, strict=True)]
    return [
        figure_tag(label_figure(result), "Success within S, M and U"),
        table([*heads, "S > M > U"], cells),
    ]


def _calibration(result: Validation) -> list[str]:
    return [
        figure_tag(calibration_figure(result), "Success over the margin"),
        bullets(sentences.calibration_of(result)),
        table(*text_tables.calibration_of(result)),
    ]


def _disagreements(result: Validation, pictures: Sequence[Bytes] | None) -> list[str]:
    if not result.reasons:
        return ["<p>No grasp that failed is labelled S, and none that held is labelled U.</p>"]
    parts = [f"<p>{NO_PICTURES}</p>"] if pictures is None and result.disagreements else []
    images = [None] * len(result.disagreements) if pictures is None else pictures
    pairs = list(zip(result.disagreements, images, strict=True))
    for kind, meaning in KINDS.items():
        reasons = [one for one in result.reasons if one.reason.kind == kind]
        if not reasons:
            continue
        cards = [_card(result, one, image) for one, image in pairs if one.kind == kind]
        rows = [[one.reason.name, f"{one.count:,}", one.reason.why] for one in reasons]
        heads = [f"likely reason, of {counted(reasons[0].of, 'grasps')}", "grasps", ""]
        parts += [f"<h3>{meaning[0].upper()}{meaning[1:]}</h3>", table(heads, rows, texts=(2,))]
        parts += ['<div class="cards">', *cards, "</div>"] if cards else []
    return parts


def _card(result: Validation, one: Disagreement, image: Bytes | None) -> str:
    """One grasp: picture, numbers and likely causes."""
    grasps, row = result.grasps, one.row
    name = f"grasp {int(grasps.grasp[row])}"
    if len(result.files) > 1:
        name += f" of {Path(result.files[int(grasps.file[row])].name).name}"
    label = Label(int(grasps.label[row])).name
    image_tag = "" if image is None else f'<img alt="{text(name)}" src="{jpeg_url(image)}">'
    hints = "".join(f"<li>{text(str(cause))}</li>" for cause in one.causes)
    return (
        f'<div class="card">{image_tag}<p><b>{text(name)}</b>, labelled {label}</p>'
        f'<p class="quiet">{text(_numbers(result, row))}</p><ul>{hints}</ul></div>'
    )


def _numbers(result: Validation, row: int) -> str:
    """The scores that a grasp has, in words."""
    values = {
        one.score: float(result.grasps.scores[one.score.name][row])
        for one in result.qualities
        if not one.score.always
    }
    reached = "reachable" if result.grasps.scores["reachable"][row] else "not reachable"
    scores = (
        f"{score.title} {value_text(score, value)}"
        for score, value in values.items()
        if not math.isnan(value)
    )
    return ", ".join([*scores, reached])


_UNITS = {
    "length": (1e3, " mm"), "area": (1e6, " mm²"), "force": (1.0, " N"), "mass": (1.0, " kg"),
}  # fmt: skip
"""Factor to the unit in which values are shown, by quantity."""


def value_text(score: Score, value: float) -> str:
    """A value of a score with its unit.

    Args:
        score: The score.
        value: Its value, in radians, metres, square metres or newtons.
    """
    if math.isinf(value):
        return "infinite"
    if score.quantity == "angle":
        return f"{math.degrees(value):.1f}°"
    factor, unit = _UNITS.get(score.quantity, (1.0, ""))
    return f"{factor * value:.3g}{unit}"


def _files(result: Validation) -> str:
    rows = [
        [
            one.name,
            one.object_name,
            f"{one.count:,}",
            f"{one.held:,}",
            f"{one.not_tried:,}",
            f"{one.not_closed:,}",
            one.hand,
        ]
        for one in result.files
    ]
    heads = ["file", "mesh", "grasps", "held", "without outcome", "jaws do not close", "gripper"]
    return table(heads, rows, texts=(0, 1, 6))


def _pictures(grasps: Sequence[Disagreement]) -> list[Bytes] | None:
    """A picture of each; None: none can be made."""
    if not grasps or not can_render():
        return None
    pictures = []
    for one in grasps:
        pictures.append(draw_disagreement(one))
        report_progress(len(pictures) / len(grasps))
    return pictures


def table(heads: Iterable[str], rows: Iterable[Iterable[str]], texts: Sequence[int] = ()) -> str:
    """A table of texts; those of the columns `texts` are aligned to the left, and wrapped."""

    def line(cells: Iterable[str], tag: str) -> str:
        kinds = dict.fromkeys(texts, 'class="text"')
        parts = (
            f"<{tag} {kinds.get(column, '')}>{text(cell)}</{tag}>"
            for column, cell in enumerate(cells)
        )
        return f"<tr>{''.join(parts)}</tr>"

    body = "\n".join(line(row, "td") for row in rows)
    return (
        f'<div class="scroll"><table><thead>{line(heads, "th")}</thead>\n<tbody>{body}</tbody>'
        "</table></div>"
    )


def bullets(lines: Iterable[str]) -> str:
    """A list of lines, which are text."""
    return "<ul>" + "".join(f"<li>{text(line)}</li>" for line in lines) + "</ul>"


def text(line: str) -> str:
    """Text as HTML, one line."""
    return escape(printable(as_unicode(line)))


def figure_tag(figure: Figure, title: str) -> str:
    """A figure as an image that is part of the page."""
    data = base64.b64encode(as_svg(figure)).decode("ascii")
    return f'<img class="figure" alt="{title}" src="data:image/svg+xml;base64,{data}">'


def jpeg_url(image: Bytes) -> str:
    """A picture (height, width, 3) as an address that contains it."""
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "JPEG", quality=QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
