"""Outcomes of grasps: the columns `outcome` and `success`, and any other values of a file."""

import json
import math
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import h5py
import numpy as np
import pyarrow as pa
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import ParallelGripper, read_grasps
from grasp3d.arrays import unit_rows
from grasp3d.errors import ContactError, SettingError
from grasp3d.grasps.pose_files import own_files, read_poses, write_poses
from grasp3d.grasps.pose_files.outcomes import outcomes_of, with_outcomes
from grasp3d.grasps.poses import GraspPoses
from grasp3d.settings.outcome import Outcome
from tests.helpers import shapes

HEAD = "px,py,pz,qx,qy,qz,qw"


def read(folder: Path, names: str, rows: list[str]) -> list[float]:
    path = folder / "log.csv"
    path.write_text("\n".join([f"{HEAD},{names}", *(f"0,0,0,1,0,0,0,{row}" for row in rows)]))
    return [None if math.isnan(one) else one for one in read_poses(path).outcome.tolist()]


@pytest.mark.parametrize("name", ["success", "outcome"])
@pytest.mark.parametrize(
    "words",
    [("1", "0", ""), ("true", "false", ""), ("yes", "no", ""), ("True", "FALSE", " "),
     ("Yes", "0", "nan"), ("1.0", "0.0", "")],
)  # fmt: skip
def test_a_table_spells_outcomes_in_several_ways(
    tmp_path: Path, name: str, words: tuple[str, ...]
) -> None:
    assert read(tmp_path, name, [*words, words[0]]) == [1.0, 0.0, None, 1.0]


@pytest.mark.parametrize("word", ["2", "maybe", "-1", "0.5", "inf"])
@pytest.mark.parametrize("first", ["1", "yes"])
def test_what_is_no_outcome_is_refused_with_its_row(tmp_path: Path, word: str, first: str) -> None:
    message = r"log.csv: grasp 3: success must be 1, true or yes .* got '?" + word
    with pytest.raises(ContactError, match=message):
        read(tmp_path, "success", [first, "0", word])


def test_both_columns_complete_each_other_and_may_not_differ(tmp_path: Path) -> None:
    assert read(tmp_path, "outcome,success", ["1,", ",no", "0,false", ","]) == [1.0, 0.0, 0.0, None]
    message = "grasp 2: its columns outcome and success contradict each other"
    with pytest.raises(ContactError, match=message):
        read(tmp_path, "outcome,success", ["1,1", "1,0"])


def test_success_is_the_outcome_in_parquet_and_json_too(tmp_path: Path) -> None:
    given = GraspPoses(poses=np.tile(np.eye(4), (3, 1, 1)), outcome=[1.0, 0.0, np.nan])
    write_poses(tmp_path / "a.parquet", given)
    table = pq.read_table(tmp_path / "a.parquet").drop_columns("outcome")
    bools = pa.array([True, False, None])
    pq.write_table(table.append_column("success", bools), tmp_path / "a.parquet")
    found = read_poses(tmp_path / "a.parquet")
    np.testing.assert_array_equal(found.outcome, given.outcome)
    assert "success" not in found.columns
    write_poses(tmp_path / "a.json", given)
    content = json.loads((tmp_path / "a.json").read_text())
    for entry, word in zip(content["grasps"], (True, "no", None), strict=True):
        del entry["outcome"]
        entry["success"] = word
    (tmp_path / "a.json").write_text(json.dumps(content))
    found = read_poses(tmp_path / "a.json")
    np.testing.assert_array_equal(found.outcome, given.outcome)
    assert "success" not in found.columns
    content["grasps"][0]["success"] = [1]
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(ContactError, match="grasp 1: success must be 1, true or yes"):
        read_poses(tmp_path / "a.json")


def test_no_further_column_can_be_called_success() -> None:
    with pytest.raises(ContactError, match="no column of poses can be called 'success'"):
        GraspPoses(poses=np.eye(4), columns={"success": np.array([1.0])})


FALL_TIMES = [0.4, 3.0, None, 2.9, 8.0]
WORDS = ["dropped", "Success", "", "dropped", " success "]
TRIES = [5, 4, 0, 3, None]
HELDS = [1, 2, 0, 3, 2]

STATED = {
    "fall_time>=3": [0.0, 1.0, None, 0.0, 1.0],
    "fall_time>3": [0.0, 0.0, None, 0.0, 1.0],
    "fall_time <= 2.9": [1.0, 0.0, None, 1.0, 0.0],
    "fall_time<2.9": [1.0, 0.0, None, 0.0, 0.0],
    "fall_time=3": [0.0, 1.0, None, 0.0, 0.0],
    "result": [0.0, 1.0, None, 0.0, 1.0],
    "result=success": [0.0, 1.0, None, 0.0, 1.0],
    "result==DROPPED/success": [1.0, 0.0, None, 1.0, 0.0],
    "held/tries": [0.0, 1.0, None, 1.0, None],
    "held/tries>=0.8": [0.0, 0.0, None, 1.0, None],
    "held/tries=1": [0.0, 0.0, None, 1.0, None],
    "flag": [0.0, 1.0, None, 0.0, 1.0],
    "flag=false": [1.0, 0.0, None, 1.0, 0.0],
}
"""Outcomes of the grasps below, by the text that states which they are."""

VALUES = {
    "fall_time": FALL_TIMES,
    "result": WORDS,
    "tries": TRIES,
    "held": HELDS,
    "flag": [False, True, None, False, True],
}
COUNT = len(FALL_TIMES)
FRANKA = ParallelGripper.preset("franka")


def plain() -> GraspPoses:
    known = np.zeros(COUNT)  # replaced by what is stated
    return GraspPoses(
        poses=np.tile(np.eye(4), (COUNT, 1, 1)), unit="m", hand=FRANKA, outcome=known, scores=known
    )


def with_values(path: Path, values: dict[str, list[object]]) -> Path:
    """A file of poses that has these values of each grasp, as its format has them."""
    suffix = path.suffix
    if suffix in {".csv", ".parquet"}:
        write_poses(path, plain())
        table = (pc.read_csv if suffix == ".csv" else pq.read_table)(path).drop_columns("outcome")
        for name, column in values.items():
            table = table.append_column(name, pa.array(column))
        (pc.write_csv if suffix == ".csv" else pq.write_table)(table, path)
    elif suffix == ".h5":
        write_poses(path, plain())
        with h5py.File(path, "a") as file:
            for name, column in values.items():
                texts = any(isinstance(one, str) for one in column)
                floats = [np.nan if one is None else one for one in column]
                file[f"grasps/sim/{name}"] = column if texts else floats
    elif suffix == ".yaml":
        write_poses(path, plain())
        content = yaml.safe_load(path.read_text())
        for number, entry in enumerate(content["grasps"].values()):
            entry.update({name: column[number] for name, column in values.items()})
        path.write_text(yaml.safe_dump(content, sort_keys=False))
    else:
        write_poses(path, plain(), format=path.stem)
        content = json.loads(path.read_text())
        if path.stem == "graspgen":
            content["grasps"].update(values)
        else:
            entries = content if path.stem == "moveit" else content["grasps"]
            for number, entry in enumerate(entries):
                entry.update({name: column[number] for name, column in values.items()})
        path.write_text(json.dumps(content))
    return path


FILES = (
    "a.csv",
    "a.parquet",
    pytest.param("a.h5", marks=pytest.mark.slow),
    "a.yaml",
    "json.json",
    "graspgen.json",
    "moveit.json",
)


def known(outcomes: np.ndarray) -> list[float | None]:
    return [None if math.isnan(one) else one for one in outcomes.tolist()]


@pytest.mark.parametrize("name", FILES)
def test_every_form_is_read_from_every_format(tmp_path: Path, name: str) -> None:
    path = with_values(tmp_path / name, VALUES)
    texts = STATED
    if name == "a.h5":  # each starts a process, and a truth value that may be missing is a number
        texts = {"flag=0": STATED["flag=false"], **dict(list(STATED.items())[2::4])}
    for text, expected in texts.items():
        assert known(read_grasps(path, hand=FRANKA, outcome=text).outcome) == expected, text


def test_names_of_data_sets_are_paths_or_their_ends(tmp_path: Path) -> None:
    path = with_values(tmp_path / "a.h5", VALUES)
    for name in ("fall_time", "sim/fall_time", "grasps/sim/fall_time"):
        found = read_poses(path, hand=FRANKA, outcome=f"{name}>=3").outcome
        assert known(found) == STATED["fall_time>=3"]
    assert (
        known(read_poses(path, outcome="sim/held/grasps/sim/tries").outcome)
        == (STATED["held/tries"])
    )
    own = read_poses(path, outcome="object_in_gripper").outcome
    np.testing.assert_array_equal(own, plain().outcome)
    with h5py.File(path, "a") as file:
        file["grasps/again/held"] = np.ones(COUNT)
        file["grasps/linked"] = h5py.ExternalLink("other.h5", "held")
        file["grasps/loop"] = file["grasps"]
        file["grasps/pairs"] = np.zeros((COUNT, 2))
    with pytest.raises(ContactError, match="'held' names 2 values: give one of grasps/again/held,"):
        read_poses(path, outcome="held")
    with pytest.raises(ContactError, match=r"called 'pairs': .*grasps/sim/fall_time") as error:
        read_poses(path, outcome="pairs")
    assert "linked" not in str(error.value)


def test_acronym_motion_during_shaking_is_an_outcome() -> None:
    name = "Mug_10f6e09036350e92b3f21f1137c3c347_0.0002682457830986903.h5"
    mug = shapes.shared("datasets", "acronym", name)
    field = "flex/object_motion_during_shaking_linear"
    with h5py.File(mug) as file:
        moved = file[f"grasps/qualities/{field}"][()]
    found = read_poses(mug, outcome=f"{field}<0.01").outcome
    assert 0 < found.sum() < len(found)
    np.testing.assert_array_equal(found, moved < 0.01)


def test_texts_of_counts_are_outcomes(tmp_path: Path) -> None:
    column = ["3 of 5", "2/5", "", "0 of 0", "5 of 5"]
    path = with_values(tmp_path / "a.csv", {"runs": column})
    assert known(read_poses(path, outcome="runs").outcome) == [1.0, 0.0, None, None, 1.0]
    assert known(read_poses(path, outcome="runs>0.6").outcome) == [0.0, 0.0, None, None, 1.0]
    path = with_values(tmp_path / "a.csv", {"runs": [*column[:4], "6 of 5"]})
    with pytest.raises(ContactError, match=r"grasp 5: runs must be 1, true or yes .* got '6 of 5'"):
        read_poses(path, outcome="runs")


def test_graspnet_rows_and_poses_in_memory_have_outcomes_too(tmp_path: Path) -> None:
    scores = np.array([0.1, 0.5, np.nan, 0.9, 0.2])
    poses = replace(plain(), scores=scores, columns={"slip": np.arange(5.0)})
    write_poses(tmp_path / "a.npy", poses)
    found = read_poses(tmp_path / "a.npy", hand=FRANKA, outcome="score>=0.5").outcome
    assert known(found) == [0.0, 1.0, None, 1.0, 0.0]
    for text, expected in (("slip<2", [1, 1, 0, 0, 0]), ("score>0.4", [0, 1, None, 1, 0])):
        assert known(with_outcomes(poses, Outcome.of(text)).outcome) == expected
    with pytest.raises(ContactError, match="no outcome is called 'fall': its grasps have score, s"):
        with_outcomes(poses, Outcome.of("fall"))


def test_a_stated_outcome_replaces_those_of_the_format(tmp_path: Path) -> None:
    path = with_values(tmp_path / "a.csv", {"success": ["odd", "?", "-", "", "x"], **VALUES})
    with pytest.raises(ContactError, match="grasp 1: success must be 1, true or yes"):
        read_poses(path)
    assert known(read_poses(path, outcome="success=odd").outcome) == [1, 0, 0, None, 0]
    both = with_values(tmp_path / "b.csv", {"success": [0, 1, 1, 1, 1], "outcome": [1] * 5})
    with pytest.raises(ContactError, match=r"contradict each other: give the one .* --outcome"):
        read_poses(both)
    assert known(read_poses(both, outcome="success").outcome) == [0, 1, 1, 1, 1]
    found = read_poses(path, outcome="result")
    assert "result" in found.columns


REFUSED = {
    "fall": r"no outcome is called 'fall': its grasps have .*fall_time, result, tries, held, flag",
    "held/falls": "no outcome is called 'held/falls': its grasps have",
    "result>=1": "grasp 1: result must be a number, or empty .* got 'dropped'",
    "result=success/lost": r"grasp 1: result must be success .* lost .* got 'dropped'",
    "result=sucess": "no grasp has result sucess, the first has 'dropped': if all failed, ",
    "tries": r"grasp 1: tries must be 1, true or yes .* got 5.*: state others with --outcome",
    "tries/held": "grasp 1: tries and held must be counts, .* got 5 of 1",
    "fall_time/tries": r"grasp 1: fall_time and tries must be counts, .* got 0\.4 of 5",
    "held/tries=most": "a share of counts must be a number; got 'held/tries=most'",
}


@pytest.mark.parametrize("text", REFUSED)
@pytest.mark.parametrize("name", ["a.csv", "json.json", "a.yaml"])
def test_what_states_no_outcome_is_refused(tmp_path: Path, name: str, text: str) -> None:
    path = with_values(tmp_path / name, VALUES)
    with pytest.raises(ContactError, match=REFUSED[text]) as error:
        read_poses(path, hand=FRANKA, outcome=text)
    assert str(error.value).startswith(str(path))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "text",
    ["", " ", "/", "held/", "/tried", "held//tried", ">=0.5", "=yes", "a>=b", "a>=", "a<inf",
     "a>nan", "a=", "a=/b", "a=b/", "a=b/c/d", "a=b/B", "a>=0.5/0.6", "a>b>3"],
)  # fmt: skip
def test_half_a_text_is_refused_with_the_forms(text: str) -> None:
    with pytest.raises(SettingError, match=r"outcome .*; it must be NAME of true or false, 1 or 0"):
        Outcome.of(text)


@pytest.mark.parametrize(
    "parts", [("a>b", "", ""), ("a", "", "b"), ("a", "~", "b"), (" a", "", "")]
)
def test_only_what_a_text_can_state_is_an_outcome(parts: tuple[str, str, str]) -> None:
    with pytest.raises(SettingError, match="says something else as text"):
        Outcome(*parts)


PLAIN = st.text(st.characters(codec="utf-8", exclude_characters="<>=/"), min_size=1).filter(
    lambda text: text == text.strip() != ""
)


@given(
    names=st.lists(PLAIN, min_size=1, max_size=3).map("/".join),
    relation=st.sampled_from(["", ">=", ">", "<=", "<", "="]),
    number=st.floats(allow_nan=False, allow_infinity=False),
    words=st.lists(PLAIN, min_size=1, max_size=2, unique_by=str.casefold).map("/".join),
)
def test_the_text_of_an_outcome_states_it(
    names: str, relation: str, number: float, words: str
) -> None:
    value = {"": "", "=": words}.get(relation, repr(number))
    outcome = Outcome(names, relation, value)
    assert Outcome.of(str(outcome)) == outcome
    assert Outcome.of(outcome) is outcome
    spaced = f" {names} {relation} {value} "
    assert Outcome.of(spaced) == outcome


NUMBERS = st.lists(st.one_of(st.none(), st.floats(-10.0, 10.0)), min_size=1, max_size=20)


@given(values=NUMBERS, low=st.floats(-10.0, 10.0), high=st.floats(-10.0, 10.0))
def test_a_higher_threshold_lets_fewer_hold(
    values: list[float | None], low: float, high: float
) -> None:
    low, high = sorted((low, high))

    def outcomes(text: str) -> np.ndarray:
        return outcomes_of(Outcome.of(text), len(values), ["x"], {"x": values}.__getitem__)

    one, other = outcomes(f"x>={low!r}"), outcomes(f"x>={high!r}")
    tried = ~np.isnan(one)
    np.testing.assert_array_equal(tried, [value is not None for value in values])
    np.testing.assert_array_equal(np.isnan(other), ~tried)
    assert (one[tried] >= other[tried]).all()
    np.testing.assert_array_equal(outcomes(f"x<{low!r}")[tried], 1.0 - one[tried])


@given(counts=st.lists(st.tuples(st.integers(0, 9), st.integers(0, 9)), min_size=1, max_size=20))
def test_counts_hold_from_their_share_on(counts: list[tuple[int, int]]) -> None:
    rows = [(min(one), max(one)) for one in counts]
    held, tried = ([row[k] for row in rows] for k in (0, 1))
    table = {"held": held, "tried": tried}
    for text, share in (("held/tried", 0.5), ("held/tried>=0.8", 0.8)):
        found = outcomes_of(Outcome.of(text), len(rows), table, table.__getitem__)
        expected = [None if not n else float(10 * k >= 10 * share * n) for k, n in rows]
        assert known(found) == expected


def test_outcomes_are_for_poses(tmp_path: Path) -> None:
    path = tmp_path / "contacts.csv"
    path.write_text("x1,y1,z1,x2,y2,z2\n0,0,0,1,0,0\n")
    with pytest.raises(SettingError, match="outcome applies to poses, not to contacts"):
        read_grasps(path, outcome="success")


def test_texts_that_memory_cannot_hold_are_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = with_values(tmp_path / "a.csv", {"note": ["x" * 100, "", None, "y", "z"]})
    assert read_poses(path).columns["note"].tolist() == ["x" * 100, "", "", "y", "z"]
    monkeypatch.setattr(own_files, "LARGEST_TEXTS", 4 * 100 * 5 - 1)
    with pytest.raises(ContactError, match="note has a text of 100 characters, too long with 5 gr"):
        read_poses(path)


MOST_SECONDS, MOST_MEMORY = 60.0, 2e9

CHECK = """
import re, sys, time
from pathlib import Path
import grasp3d
from grasp3d.settings.outcome import Outcome
from grasp3d.validating.tried_grasps import check_grasps
hand = grasp3d.read_hand("franka")
start = time.perf_counter()
(tried,) = check_grasps([sys.argv[1]], mesh="any.stl", hand=hand, outcome=Outcome.of(sys.argv[2]))
seconds = time.perf_counter() - start
memory = re.search(r"VmHWM:\\s+(\\d+)", Path("/proc/self/status").read_text())[1]
print(tried.count, seconds, memory)
"""
"""Prints grasps with an outcome, time [s], and memory [kB]: ru_maxrss would count that of the
process that started it."""


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="it reads the memory used as Linux states it")
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_a_million_grasps_are_checked_in_time_and_memory(tmp_path: Path, suffix: str) -> None:
    count = 1_000_000
    random = np.random.default_rng(0)
    turned = unit_rows(random.normal(size=(count, 4)))
    positions = random.normal(size=(count, 3))
    table = pa.table({
        "name": [f"grasp {k}" for k in range(count)],
        **dict(zip(("px", "py", "pz"), positions.T, strict=True)),
        **dict(zip(("qx", "qy", "qz", "qw"), turned.T, strict=True)),
        "result": np.where(random.random(count) < 0.4, "success", "failure"),
        "unit": ["m"] * count,
    })  # fmt: skip
    path = tmp_path / f"a{suffix}"
    (pc.write_csv if suffix == ".csv" else pq.write_table)(table, path)
    command = [sys.executable, "-c", CHECK, str(path), "result=success/failure"]
    done = subprocess.run(command, check=True, capture_output=True, text=True)
    tried, seconds, memory = map(float, done.stdout.split())
    assert tried == count
    assert seconds < MOST_SECONDS
    assert 1024 * memory < MOST_MEMORY
