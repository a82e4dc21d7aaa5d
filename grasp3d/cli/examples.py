"""Examples at the end of every command's help."""

EXAMPLES: dict[str, tuple[tuple[str, str], ...]] = {
    "label": (
        ("Label a mug for a gripper that opens 60 mm", "label meshes/mug.glb --max-opening 60mm"),
        (
            "The best grasps of three fingers, for a mesh whose file states no unit",
            "label meshes/box.obj --unit m --fingers 3 --max-spread 12cm --best 4",
        ),
    ),
    "check": (
        ("Diagnose one mesh", "check meshes/mug.glb"),
        (
            "Diagnose all meshes of a folder, and write a table",
            "check meshes --unit m --max-opening 60mm -o meshes.csv",
        ),
    ),
    "evaluate": (
        (
            "Evaluate the grasps in a table, in the unit of the mesh",
            "evaluate meshes/mug.glb grasps.csv --friction 0.8",
        ),
        (
            "Accept contacts up to 5 mm from the surface",
            "evaluate meshes/mug.glb grasps.csv --max-distance 5mm -o evaluated.json",
        ),
    ),
    "validate": (
        (
            "How well labels predict a robot's log of grasps on one object",
            "validate tried.csv --mesh meshes/mug.glb --hand franka -o validated",
        ),
        (
            "For rubber pads, with a table of S, M and U at other resolutions",
            "validate tried.csv --mesh meshes/mug.glb --friction 0.8 --sensor-resolutions 0 5:20:5",
        ),
    ),
    "simulate": (
        (
            "Do grasps of a box hold as their labels say?",
            "simulate meshes/box.obj --unit m --count 6 --pull-time 0.2",
        ),
        (
            "With uncertain friction, as a table of Parquet",
            "simulate meshes/box.obj --unit m --friction 0.4..0.6 --count 6 -o simulated.parquet",
        ),
    ),
    "batch": (
        ("Label all meshes of a folder", "batch meshes -o results"),
        (
            "Only GLB files, which state their unit, with two processes",
            "batch 'meshes/*.glb' -o results_glb --max-opening 80mm --workers 2",
        ),
    ),
    "sweep": (
        ("The circle of the paper and a mug", "sweep circle meshes/mug.glb --friction 0.5"),
        (
            "How fine a sensor half of a folder's surfaces require",
            "sweep 'meshes/*.glb' --friction 0.5 --fraction 0.5 --max-opening 80mm -o glb.csv",
        ),
    ),
    "perturb": (
        (
            "The errors to enter for a scan with errors of 0.3 mm",
            "perturb meshes/knob.ply --unit m --noise 0.3mm --copies 10 --patch-radius 5mm",
        ),
        (
            "For a filtered depth image, whose errors are alike over 4 mm",
            "perturb meshes/knob.ply --unit m --noise 1mm --correlation 4mm --copies 10",
        ),
    ),
    "design": (
        ("The coarsest sensor for two frictions", "design --friction 0.2 0.5"),
        (
            "What each uncertainty of a finger costs, and the encoders that it needs",
            "design --friction 0.4..0.6 --receptive-field 4mm --joint-lengths 6cm --object-size 50",
        ),
    ),
    "hand": (
        ("Print a gripper, and draw it", "hand franka --picture franka.png"),
        (
            "Describe the hand of a URDF by the links of its fingers",
            "hand hand.urdf --fingers left_finger right_finger -o gripper.json",
        ),
    ),
    "view": (
        ("Open a window", "view meshes/mug.glb"),
        (
            "Write a picture instead, which needs no display",
            "view meshes/mug.glb --paint max_resolution --screenshot mug.png",
        ),
    ),
    "warmup": (
        ("Compile the kernels for two fingers", "warmup"),
        ("Also those for three, four and five fingers", "warmup --fingers 3"),
        ("Into a folder, as for an image of a container", "warmup --cache kernels"),
    ),
    "paper": (
        ("All figures and numbers", "paper -o paper"),
        (
            "For another friction, with a mesh of your own",
            "paper -o paper_mug --friction 0.5 --object meshes/mug.glb",
        ),
    ),
}
"""What they do, and the words after `grasp3d`, by the name of the command. The folder `meshes` is
the one that comes with the package, `grasps.csv` a table with columns x1 y1 z1 x2 y2 z2,
`tried.csv` one of poses with outcomes,
`hand.urdf` a robot's hand."""

_OF_ALL = (
    ("Label a mesh, and write it", EXAMPLES["label"][0][1]),
    ("The options of a command", "label --help"),
)


def print_examples(command: str) -> None:
    """Print the examples of a command, or those of the program.

    Args:
        command: Name of the command; another word: the program.
    """
    lines = [f"  # {text}\n  grasp3d {words}" for text, words in EXAMPLES.get(command, _OF_ALL)]
    print("\n".join(["examples:", *lines]))  # noqa: T201
