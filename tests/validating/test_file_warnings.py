from grasp3d.validating.file_warnings import FileWarnings


def test_what_files_have_in_common_is_said_once() -> None:
    warnings = FileWarnings()
    for number in range(7):
        warnings.add(f"logs/{number}.csv", f"mug{number}.obj: is open", f"mug{number}.obj")
        warnings.add(f"logs/{number}.csv", "no density is stated")
    warnings.add("logs/0.csv", "3 poses start inside")
    warnings.add("logs/1.csv", "12 poses start inside")
    warnings.add("logs/2.csv", "all is well")
    first = "0.csv, 1.csv, 2.csv, 3.csv, 4.csv, ...)"
    assert warnings.lines() == [
        f"mug0.obj: is open (and the like in 7 files: {first}",
        f"no density is stated (7 files: {first}",
        "3 poses start inside (and the like in 2 files: 0.csv, 1.csv)",
        "logs/2.csv: all is well",
    ]
