"""Draw figures of Wan & Howe 2018, as `grasp3d paper` does, for the documentation.

    python scripts/make_paper_pictures.py -o docs

Writes `paper_cones.png` (their Fig. 5), `paper_epsilon.png` (Fig. 7) and `paper_fractions.png`
(Fig. 8).
"""

import argparse
from pathlib import Path

from grasp3d.paper.figures import FIGURES
from grasp3d.paper.paper_settings import PaperSettings

SHOWN = {
    "paper_cones": "figure_05",
    "paper_epsilon": "figure_07",
    "paper_fractions": "figure_08",
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
