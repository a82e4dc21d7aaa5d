"""Words that this project leaves out, for the reader's sake, and where they stay with a reason.

One word for one thing: the documentation's page on developing lists which. Prints every reason with
the number of lines that it excuses, then the lines without one; exits with 1 where there are any.
"""

import re
import sys
from collections import Counter
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[1]

PLACES = ("grasp3d/**/*.py", "grasp3d/**/*.pyi", "tests/**/*.py", "scripts/*.py", "docs/**/*.md",
          "docs/**/*.py", "web/src/**/*.*", "web/build.mjs", "*.md", "meshes/*.md",
          ".ci/run")  # fmt: skip
"""Files that are searched."""

LEFT_OUT = {
    "place": "contact point, surface point, position",
    "spot": "contact point",
    "mate": "opposing contact",
    "trial": "candidate",
    "hands": "multi-finger grasps",
    "pool": "candidate points",
    "ground": "candidate points",
    "settle": "evaluate, decide, classify",
    "straight": "antipodal",
    "bench": "workspace",
    "desk": "workspace",
    "room": "workspace, layer, package",
    "share": "area fraction, fraction",
    "widen": "cone offset",
    "told": "message, report",
    "tell": "print, report, return",
    "doubt": "warning",
    "crew": "workers",
    "telling": "message",
    "recalling": "cache",
    "standing": "candidate points",
    "house": "package",
    "floor": "layer",
    "door": "module",
}
"""Each word in its simplest form, and what is written instead."""

FORMS = {
    "place": "places?", "spot": "spots?", "mate": "mates?", "trial": "trials?", "pool": "pools?",
    "settle": "settle[sd]?|settling", "bench": "bench(?:es)?", "room": "rooms?",
    "share": "shares?", "widen": "widen(?:s|ed|ing)?", "tell": "tells?", "doubt": "doubt(?:s|ed)?",
    "house": "houses?", "floor": "floors?", "door": "doors?", "desk": "desks?",
}  # fmt: skip

REASONS = (
    (
        "pool",
        r"ThreadPool|ProcessPool|pool\.map|^(?:grasp3d|tests)/(?:isolation|reading)/",
        "pools of threads and of processes",
    ),
    ("floor", r"(?:np|math|Math)\.floor", "rounding down"),
    (
        "share",
        r"(?i)(?:that|they|which|would|nodes|machines|vertices|vertex|bodies|threads) shares?\b",
        "to have in common, a verb",
    ),
    ("share", r"shares? (?:a|an|one|its|their|the|most|vertices)\b", "to have in common, a verb"),
    ("share", r"/share/", "a path of the system"),
    ("bench", r"bench_", "benchmark scripts are called so"),
    (
        "straight",
        r"[Ss]traight (?:walk|line|within|from|on|over|=)|[^ ]straight|STRAIGHT|is straight",
        "straight lines and walks over a surface",
    ),
    (
        "straight",
        r"(?i)straight (?:approach|way|motion|path|to\b|down|up\b|through)|straight line",
        "the straight motion of a gripper",
    ),
    (
        "settle",
        r"^grasp3d/_kernels/(?:closing|settl|jaw)|test_settling|object.*settle|settles? between",
        "a free object that comes to rest between jaws",
    ),
    ("place", r"post_place_retreat", "a field of ROS messages"),
    ("place", r"(?i)\bin place\b|Place contact", "in place; to place, a verb"),
    ("hands", r"most hands", "hands of robots"),
    ("hands", r"multifingered|robotic hands", "titles of papers"),
    ("bench", r"DexGraspBench", "the name of a program"),
    ("ground", r"--ground", "the background colour of pages"),
    ("widen", r"_widened|widen the search", "a range that is made wider, not a cone"),
    ("tell", r"cannot_tell", "the meaning of M, as labelled files state it"),
    (
        "standing",
        r"standing on z|= standing\(|def standing\(|return standing\(|of\(standing\(|\bStanding\b",
        "an object that stands on a table",
    ),
)
"""(word, pattern, reason): a line that matches the pattern may hold the word."""


def pattern_of(*words: str) -> re.Pattern[str]:
    """What finds the forms of words, also as parts of identifiers with underscores."""
    forms = "|".join(FORMS.get(word, word) for word in words)
    return re.compile(rf"(?<![a-z])(?:{forms})(?![a-z])", re.IGNORECASE)


def lines_with_words() -> Iterator[tuple[str, str, str]]:
    """(word, file and line, text) of every line that holds a word, in identifiers too."""
    patterns = {word: pattern_of(word) for word in LEFT_OUT}
    any_word = pattern_of(*LEFT_OUT)  # most lines hold none
    for path in sorted({path for glob in PLACES for path in ROOT.glob(glob)}):
        if path.stem in {"check_words", "test_words"} or not path.is_file():
            continue
        for number, line in enumerate(path.read_text(encoding="utf-8").splitlines(), 1):
            parted = re.sub(r"([a-z])([A-Z])", r"\1_\2", line)
            if any_word.search(parted):
                words = (word for word, pattern in patterns.items() if pattern.search(parted))
                yield from (
                    (word, f"{path.relative_to(ROOT)}:{number}", line.strip()) for word in words
                )


def main() -> int:
    """Print the list; returns the exit code."""
    excused: Counter[tuple[str, str]] = Counter()
    unexplained = []
    for word, where, line in lines_with_words():
        text = f"{where}: {line} {line.replace('_', ' ')}"
        reasons = (why for w, pattern, why in REASONS if w == word and re.search(pattern, text))
        reason = next(reasons, None)
        if reason is None:
            unexplained.append(f"{where}: '{word}' (write {LEFT_OUT[word]}): {line[:120]}")
        else:
            excused[word, reason] += 1
    for (word, reason), count in sorted(excused.items()):
        print(f"{word}: {count} lines stay: {reason}")
    print(*unexplained, sep="\n")
    print(f"{len(unexplained)} lines without a reason")
    return 1 if unexplained else 0


if __name__ == "__main__":
    sys.exit(main())
