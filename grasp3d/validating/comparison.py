"""Comparison of all scores with the outcomes."""

from collections.abc import Iterator, Sequence

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.settings import GraspModel
from grasp3d.system.progress import Progress
from grasp3d.validating.calibration import calibrate
from grasp3d.validating.evaluating import Evaluation
from grasp3d.validating.intervals import FEW_OBJECTS, bootstrap
from grasp3d.validating.label_success import LabelSuccess, label_success, labels_at
from grasp3d.validating.ranking import RankedOutcomes
from grasp3d.validating.scores import SCORES
from grasp3d.validating.validation import ScoredGrasps, ScoreQuality, Validation
from grasp3d.validating.validation_settings import LEAST_RESAMPLES, ValidationSettings

MOST_DRAWN = 100_000_000
"""Most grasps that all resamples draw, which takes one and a half minutes."""


FEW_OUTCOMES = 10
"""Grasps that held, or failed, below which a warning says so."""


def compared(done: Evaluation, settings: ValidationSettings, progress: Progress) -> Validation:
    """Compare the scores of evaluated grasps with their outcomes.

    Args:
        done: The evaluated grasps, at least one of which closes.
        settings: Grid of the labels, bins, resamples and seed.
        progress: Called with the fraction of the work done, from 0 to 1.
    """
    grasps, model = _joined(done.parts), done.models[0]
    by_object, resamples = len(done.objects) > 1, _resamples(grasps.size, settings.resamples)
    return Validation(
        files=tuple(done.files),
        grasps=grasps,
        model=model,
        settings=settings,
        qualities=_qualities(grasps, resamples, settings.seed, progress, by_object=by_object),
        by_object=by_object,
        resamples=resamples,
        labels=tuple(_labels(grasps, model, settings)),
        calibration=calibrate(
            grasps.held, grasps.scores["margin"], bins=settings.bins, target=settings.target
        ),
        disagreements=done.disagreements.all(),
        warnings=(*done.warnings, *_warnings(done, grasps)),
    )


def _warnings(done: Evaluation, grasps: ScoredGrasps) -> Iterator[str]:
    """Sentences on outcomes and objects that leave little to say."""
    names = ", ".join(one.name for one in done.files[:5])
    if grasps.held.all() or not grasps.held.any():
        became = "held" if grasps.held.all() else "failed"
        yield f"{names}: all {grasps.size} grasps {became}, so no score can be ranked"
    least = min(int(grasps.held.sum()), int((~grasps.held).sum()))
    if 0 < least < FEW_OUTCOMES:
        rare = "held" if grasps.held.sum() == least else "failed"
        yield (
            f"only {least} of {grasps.size} grasps {rare}: scores, intervals and thresholds of so "
            "few say little about other grasps"
        )
    if 1 < len(done.objects) < FEW_OBJECTS:
        yield (
            f"intervals by object are of {len(done.objects)} objects only, too few to know how "
            "much objects differ: they are too narrow"
        )
    if len({one.sensor_resolution for one in done.models}) > 1:
        yield "the grippers state different sensor resolutions: labels and margins are of each"


def _resamples(size: int, wanted: int) -> int:
    """Resamples for so many grasps: so many that all together draw few enough of them."""
    return max(min(wanted, MOST_DRAWN // max(size, 1)), LEAST_RESAMPLES)


def _joined(parts: Sequence[ScoredGrasps]) -> ScoredGrasps:
    """All grasps; scores that some files lack are nan there."""
    names = [score.name for score in SCORES if any(score.name in part.scores for part in parts)]
    joined = {
        name: locked(np.concatenate([_score(part, name) for part in parts])) for name in names
    }
    rest = {
        name: locked(np.concatenate([getattr(part, name) for part in parts]))
        for name in vars(parts[0])
        if name != "scores"
    }
    return ScoredGrasps(scores=joined, **rest)


def _score(part: ScoredGrasps, name: str) -> Floats:
    return part.scores[name] if name in part.scores else np.full(part.size, np.nan)


def _qualities(
    grasps: ScoredGrasps, resamples: int, seed: int, progress: Progress, *, by_object: bool
) -> tuple[ScoreQuality, ...]:
    """ROC-AUC and average precision of each score, with intervals."""
    scores = [score for score in SCORES if score.name in grasps.scores]
    ranked = [RankedOutcomes.of(grasps.held, grasps.ranked(score)) for score in scores]
    measures = [measure for one in ranked for measure in (one.roc_auc, one.average_precision)]
    clusters = grasps.object_number if by_object else np.arange(grasps.size)
    ends = bootstrap(measures, clusters, resamples=resamples, seed=seed, progress=progress).reshape(
        len(scores), 2, 2
    )
    return tuple(
        ScoreQuality(
            score=score,
            roc_auc=one.roc_auc(),
            roc_auc_interval=(float(area[0]), float(area[1])),
            average_precision=one.average_precision(),
            average_precision_interval=(float(precision[0]), float(precision[1])),
        )
        for score, one, (area, precision) in zip(scores, ranked, ends, strict=True)
    )


def _labels(
    grasps: ScoredGrasps, model: GraspModel, settings: ValidationSettings
) -> Iterator[LabelSuccess]:
    """Success within S, M and U over the grid of the settings."""
    for friction in settings.frictions:
        for resolution in settings.sensor_resolutions:
            codes = labels_at(
                grasps.located_worst, grasps.located_best, model, friction, resolution
            )
            yield label_success(grasps.held, codes, friction, resolution)
