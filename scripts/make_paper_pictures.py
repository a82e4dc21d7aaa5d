"""Draw figures of Wan & Howe 2018, as `grasp3d paper` does, for the documentation.

    python scripts/make_paper_pictures.py -o docs

Writes `paper_tips.png` (their Fig. 4), `paper_cones.png` (Fig. 5), `paper_epsilon.png` (Fig. 7),
`paper_fractions.png` (Fig. 8) and `paper_ceilings.png` (Fig. 11), and, of uncertainties that they
name only, `paper_errors.png` and `paper_map.png`.
"""

import argparse
from pathlib import Path

from grasp3d.paper.figures import FIGURES
from grasp3d.paper.paper_settings import PaperSettings

SHOWN = {
    "paper_tips": "figure_04",
    "paper_cones": "figure_05",
    "paper_epsilon": "figure_07",
    "paper_fractions": "figure_08",
    "paper_ceilings": "figure_11",
    "paper_errors": "extension_errors",
    "paper_map": "extension_map",
}


def main() -> None:
    """Draw and write the figures."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path(), help="folder")
    folder = parser.parse_args().output
    for name, figure in SHOWN.items():
        FIGURES[figure](PaperSettings()).savefig(folder / f"{name}.png", dpi=140)


if __name__ == "__main__":
    main()
