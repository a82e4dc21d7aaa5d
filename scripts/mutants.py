"""Plant one small error at a time, and run tests against it.

mutants.py                      all, two at a time, with a table of which were caught
mutants.py --only force tilt    those whose names contain one of the words
mutants.py --root FOLDER        in another checkout, such as an older one

Each error is a text that the package contains exactly once, in any module, and its replacement.
For each error, package and tests are copied to a temporary folder, and kernels are compiled again
if the error is in one. The quick tests of the named files run first and, if they pass, the slow
ones. An error that no test catches survives: a test is missing. The script also tests that the same
tests pass without any error. The exit code is 1 if an error survived.
"""

import argparse
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]

LONGEST = 600.0
"""Time limit of one run of tests [s]; an error may well make a loop endless."""

OUTCOMES = {0: "survived", 1: "caught", 2: "caught", 5: "survived", None: "no end"}
"""Outcomes by exit code of pytest: 2 if a module cannot be imported, 5 if no test is so marked."""


@dataclass(frozen=True)
class Mutant:
    """An error to plant."""

    name: str
    text: str
    replacement: str
    tests: str
    """Names of test files, anywhere below `tests/`."""


MUTANTS = (
    # Quality: wrenches, closure, tilts, forces.
    Mutant(
        "squeeze takes the better finger",
        "squeeze = np.maximum(angles_between(normals[:, 0], line)",
        "squeeze = np.minimum(angles_between(normals[:, 0], line)",
        "test_critical_angle.py",
    ),
    Mutant(
        "cone edges with the tangent",
        "np.sin(friction_angle, out=parts[..., 1])",
        "np.tan(friction_angle, out=parts[..., 1])",
        "test_wrenches.py test_ferrari_canny.py",
    ),
    Mutant(
        "torsion one way only",
        "[1.0, 0.0, 0.0, -1.0]",
        "[1.0, 0.0, 0.0, 1.0]",
        "test_wrenches.py test_ferrari_canny.py",
    ),
    Mutant(
        "force of wider cones as the largest",
        "some.friction_angle - tilts[sure]",
        "some.friction_angle + tilts[sure]",
        "test_force_ranges.py",
    ),
    Mutant(
        "a ring of points that is too small",
        "(self.torsion_radius / friction)[..., None, None]",
        "(0.9 * self.torsion_radius / friction)[..., None, None]",
        "test_contacts.py",
    ),
    Mutant(
        "location error of half a turn",
        "np.arcsin(sines)",
        "np.arccos(sines)",
        "test_uncertain_angles.py",
    ),
    # Search: critical angles, extreme normals and samples of surfaces.
    Mutant(
        "worst and best normals exchanged",
        "np.concatenate([inner - radii, outer + radii])",
        "np.concatenate([inner + radii, outer - radii])",
        "test_critical_angles.py test_exact.py",
    ),
    Mutant(
        "surely stable at the best normals",
        "labels[rows[worst.stable]] = Label.S",
        "labels[rows[~best.unstable]] = Label.S",
        "test_extreme_normals.py test_scanning.py",
    ),
    Mutant(
        "cone as wide at a crease",
        "own = math.cos(angle - radius) if radius > 0.0 else cosine",
        "own = cosine",
        "test_multifinger_truth.py",
    ),
    Mutant(
        "closing pad shifted to the other side",
        "centred[:, :3, 3] += offset",
        "centred[:, :3, 3] -= offset",
        "test_closing.py test_collisions.py",
    ),
    Mutant(
        "scan keeps the worst of best angles",
        "best[v] = min(best[v], low)",
        "best[v] = max(best[v], low)",
        "test_kernels.py",
    ),
    Mutant(
        "search cone without the spread of normals",
        "min(cone + origins.radii[v], math.pi)",
        "min(cone, math.pi)",
        "test_kernels.py test_antipodal.py",
    ),
    Mutant(
        "partners of any distance",
        "if opening > largest:",
        "if opening > 9.0 * largest:",
        "test_antipodal.py test_labelling.py",
    ),
    # Hulls.
    Mutant(
        "multiplier of the cap with the wrong sign",
        "k, target = (c - along) / per_k, flat",
        "k, target = (along - c) / per_k, flat",
        "test_cap_maximum.py",
    ),
    Mutant(
        "undecided counts as closed",
        "closed = not is_open and least < lower < math.inf",
        "closed = not is_open and lower < math.inf",
        "test_ferrari_canny.py test_degenerate.py",
    ),
    Mutant(
        "proven angle of the last contact",
        "least = min(least, math.atan2(across, along) - 0.5 * math.pi - wider[i])",
        "least = math.atan2(across, along) - 0.5 * math.pi - wider[i]",
        "test_critical_angle.py",
    ),
    Mutant(
        "facets combined beyond the horizon",
        "s, t = heights[v], -min(heights[other], 0.0)",
        "s, t = heights[v], min(heights[other], 0.0)",
        "test_growing_hull.py",
    ),
    # Forces.
    Mutant(
        "task within a cone loses its sine",
        "reach = along * cosine + math.sqrt(max(length * length - along * along, 0.0)) * sine",
        "reach = along * cosine + math.sqrt(max(length * length - along * along, 0.0))",
        "test_tasks.py",
    ),
    Mutant(
        "torque of the third force component",
        "remainder[c] = -wrench[c] if c < 3 else",
        "remainder[c] = -wrench[c] if c < 4 else",
        "test_grip_forces.py",
    ),
    # Jaws.
    Mutant(
        "touched patch without compliance",
        "limit = position + max(jaw.compliance, MIN_DEPTH)",
        "limit = position + MIN_DEPTH",
        "test_closing.py",
    ),
    Mutant(
        "solid counted from one side",
        "total += 1 if side * normal[0] > 0.0 else -1",
        "total += 1 if normal[0] > 0.0 else -1",
        "test_closing.py",
    ),
    Mutant(
        "object turns the wrong way",
        "motion[1, 0], motion[2, 0] = sine * z, -sine * y",
        "motion[1, 0], motion[2, 0] = -sine * z, sine * y",
        "test_settling.py",
    ),
    Mutant(
        "fingers without the radius of their tips",
        "found[DEPTH] = top + shape.tip_radius",
        "found[DEPTH] = top",
        "test_reach.py test_collisions.py",
    ),
    Mutant(
        "gripper within a solid not seen",
        "return winding > INSIDE",
        "return winding < -INSIDE",
        "test_collisions.py",
    ),
    Mutant(
        "way of a closing jaw ends at its start",
        "found[PREGRASP] = opening + 2.0 * sign * shape.clearance",
        "found[PREGRASP] = opening + sign * shape.clearance",
        "test_reach.py",
    ),
    # Meshes, settings, files, pictures, the viewer and libraries.
    Mutant(
        "centroid of tets",
        "(corners.sum(axis=1) / 4.0)",
        "(corners.sum(axis=1) / 3.0)",
        "test_preparing.py",
    ),
    Mutant(
        "closed by parity",
        "return not edges_of(faces).balance.any()",
        "return not (edges_of(faces).faces % 2).any()",
        "test_repair.py test_preparing.py test_diagnosing.py",
    ),
    Mutant(
        "normals not weighted by angle",
        "weights = surface.angles.ravel()",
        "weights = np.ones(faces.size)",
        "test_preparing.py",
    ),
    Mutant(
        "twins in wrong order",
        "straight = own == right[0]",
        "straight = own == right[1]",
        "test_preparing.py",
    ),
    Mutant(
        "cavity gap sign",
        "gap = -touch if shares else touch",
        "gap = touch if shares else -touch",
        "test_repair_bodies.py test_repair.py",
    ),
    Mutant(
        "inward stray not flipped",
        "            flip[number] ^= True",
        "            pass",
        "test_repair_bodies.py test_repair.py",
    ),
    Mutant(
        "weld even through plates",
        "if not len(uneven) or has_area(points, faces[lost], rounding).any():",
        "if not len(uneven):",
        "test_repair.py test_repair_laws.py",
    ),
    Mutant(
        "weights swapped on an edge",
        "= 1.0 - along[on], along[on]",
        "= along[on], 1.0 - along[on]",
        "test_surface_points.py",
    ),
    Mutant(
        "relative index",
        "[k - 1 if k > 0 else count + k for k in numbers]",
        "[k - 1 if k > 0 else count + k - 1 for k in numbers]",
        "test_reading.py",
    ),
    Mutant(
        "two parents allowed",
        "        if number in found:\n            raise",
        "        if number in found and not number:\n            raise",
        "test_gltf.py",
    ),
    Mutant(
        "lengths not scaled in tuples",
        "scaled = tuple(with_lengths_scaled(one, factor) for one in value)",
        "scaled = value",
        "test_units.py test_values.py",
    ),
    Mutant(
        "pose error axis",
        "TOWARD = (0.0, 0.5, -(0.75**0.5))",
        "TOWARD = (0.5, 0.0, -(0.75**0.5))",
        "test_settings.py",
    ),
    Mutant(
        "range end",
        'above = least < value if ends[0] == "(" else least <= value',
        "above = least < value",
        "test_settings.py",
    ),
    Mutant(
        "byte order lost",
        "self.type = self.type.newbyteorder(state[1])",
        "pass",
        "test_pickled_arrays.py",
    ),
    Mutant(
        "hidden S called M",
        "hidden = (codes == Label.M) & (worst > searched) & (stable > searched)",
        "hidden = (codes == Label.M) & (worst > searched) & (stable < searched)",
        "test_colors.py",
    ),
    Mutant(
        "camera behind",
        "across = math.atan2(along, -beside)",
        "across = math.atan2(along, beside)",
        "test_camera.py",
    ),
    Mutant(
        "failures kept",
        "            self._failed.clear()\n",
        "            pass\n",
        "test_session.py",
    ),
    Mutant(
        "wider search overrides",
        "better = beyond & (wide.critical_angle < narrow.critical_angle)",
        "better = wide.critical_angle <= narrow.critical_angle",
        "test_session.py test_gripper.py",
    ),
    Mutant(
        "stale run taken",
        "            if run is self._run:\n",
        "            if True:\n",
        "test_session.py",
    ),
    Mutant(
        "largest memory limit",
        "return min(limit for limit in limits if limit > 0.0) / 1e9",
        "return max(limit for limit in limits if limit > 0.0) / 1e9",
        "test_running.py",
    ),
    Mutant(
        "threads of last jobs",
        "processes // (len(pending) + len(jobs) - number)",
        "processes // (len(pending) + len(jobs) - number + 1)",
        "test_running.py",
    ),
    Mutant(
        "diagnosis trusts crossings",
        "Trust.NO if fraction > SELF_INTERSECTING else Trust.CARE",
        "Trust.NO if fraction < SELF_INTERSECTING else Trust.CARE",
        "test_diagnosing.py",
    ),
    Mutant(
        "parts that leave out the first mesh",
        "settled[first - 1 :: parts]",
        "settled[first::parts]",
        "test_library.py",
    ),
    Mutant(
        "inward normals in rows",
        "_triples(-contacts.normals[row])",
        "_triples(contacts.normals[row])",
        "test_labelling.py",
    ),
    Mutant(
        "the oldest row of a mesh holds",
        'tuple(sorted(chunks, key=lambda one: one.head["written"]))',
        'tuple(sorted(chunks, key=lambda one: -one.head["written"]))',
        "test_chunks.py",
    ),
)


@dataclass(frozen=True)
class Verdict:
    """Result of the tests for an error."""

    name: str
    place: str
    """Module and line of the error."""
    outcome: str
    """One of OUTCOMES, or pytest's exit code."""
    by: str
    """The test that caught it."""
    seconds: float


def place_of(mutant: Mutant, root: Path) -> tuple[Path, int]:
    """Find the module, relative to the root, and the line with the text of a mutant."""
    places = []
    for path in sorted((root / "grasp3d").rglob("*.py")):
        before, *others = path.read_text(encoding="utf-8").split(mutant.text)
        places += [(path.relative_to(root), before.count("\n") + 1)] * len(others)
    if len(places) != 1:
        raise SystemExit(f"{mutant.name}: {mutant.text!r} is {len(places)} times in the package")
    return places[0]


def copy_tree(root: Path, folder: Path) -> None:
    """Copy what tests need from a checkout; link pages and meshes, which they only read.

    Machine code is copied, too; it stays valid unless a kernel is changed.
    """
    for name in ("grasp3d", "tests", "scripts"):
        shutil.copytree(root / name, folder / name, ignore=shutil.ignore_patterns("*.pyc"))
    shutil.copy(root / "pyproject.toml", folder)
    for name in ("docs", "meshes", "README.md"):
        (folder / name).symlink_to(root / name)
    if (root.parent / "shared").is_dir():  # reference results
        (folder.parent / "shared").symlink_to(root.parent / "shared")


def run_tests(folder: Path, files: Sequence[str], marked: str) -> tuple[int | None, str]:
    """Exit code of pytest, None if it did not end in time, and the first test that failed."""
    paths = [str(path) for name in files for path in sorted((folder / "tests").rglob(name))]
    environment = os.environ | {"PYTHONPATH": str(folder)}
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:cacheprovider", "-m", marked]
    try:
        ran = subprocess.run(  # noqa: S603 - the tests of this checkout
            [*command, "--hypothesis-seed=0", *paths],
            cwd=folder, env=environment, capture_output=True, text=True, timeout=LONGEST,
            check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return None, f"after {LONGEST:g} s"
    failed = re.search(r"^(?:FAILED|ERROR) (?:\S*/)?(\S+)", ran.stdout, re.MULTILINE)
    return ran.returncode, failed[1] if failed else ran.stdout[-300:] + ran.stderr[-300:]


def judge(mutant: Mutant, root: Path) -> Verdict:
    """Plant an error in a copy and run its tests."""
    begun, (module, line) = time.monotonic(), place_of(mutant, root)
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary, "grasp3d")
        folder.mkdir()
        copy_tree(root, folder)
        planted = folder / module
        text = planted.read_text(encoding="utf-8")
        planted.write_text(text.replace(mutant.text, mutant.replacement), encoding="utf-8")
        for marked in ("not slow", "slow"):
            code, by = run_tests(folder, mutant.tests.split(), marked)
            if code not in {0, 5}:  # 5: no test has this mark
                break
    outcome = OUTCOMES.get(code, f"pytest: {code}")
    place = f"{module.relative_to('grasp3d')}:{line}"
    return Verdict(mutant.name, place, outcome, by if code else "", time.monotonic() - begun)


def check_without(mutants: Sequence[Mutant], root: Path) -> None:
    """Exit with a message if the tests fail without any error planted."""
    files = sorted({name for mutant in mutants for name in mutant.tests.split()})
    with tempfile.TemporaryDirectory() as temporary:
        folder = Path(temporary, "grasp3d")
        folder.mkdir()
        copy_tree(root, folder)
        code, by = run_tests(folder, files, "not slow")
    if code:
        raise SystemExit(f"without any error a test fails: {by}")


def main() -> int:
    """Print a line per mutant."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--only", nargs="+", default=[""], help="words of the names")
    parser.add_argument("--root", type=Path, default=ROOT, help="the checkout")
    parser.add_argument("--jobs", type=int, default=2, help="how many at a time")
    arguments = parser.parse_args()
    root = arguments.root.resolve()
    mutants = [one for one in MUTANTS if any(word in one.name for word in arguments.only)]
    for mutant in mutants:
        place_of(mutant, root)
    check_without(mutants, root)
    survived = 0
    with ThreadPoolExecutor(arguments.jobs) as pool:
        for number, done in enumerate(pool.map(lambda one: judge(one, root), mutants), 1):
            survived += done.outcome not in {"caught", "no end"}
            print(
                f"{number:2d} {done.outcome:9s} {done.seconds:4.0f} s  {done.name:42s} "
                f"{done.place:42s} {done.by}",
                flush=True,
            )
    print(f"{len(mutants) - survived} of {len(mutants)} caught")
    return int(survived > 0)


if __name__ == "__main__":
    sys.exit(main())
