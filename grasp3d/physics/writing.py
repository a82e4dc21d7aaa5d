"""Files of simulated grasps."""

from pathlib import Path
from typing import Any

from grasp3d.conversions import chosen_settings
from grasp3d.physics.simulation import Simulation
from grasp3d.settings.parsing import plain_values
from grasp3d.system.versions import package_version
from grasp3d.tables import write_columns


def write_simulation(path: str | Path, found: Simulation) -> None:
    """Write a row for each simulated grasp: outcome, label, margin and contacts.

    The columns are those of `Simulation.columns`.

    Args:
        path: File to make or replace: .csv or .parquet, which stores the settings too.
        found: The simulated grasps.

    Raises:
        OutputError: The suffix is unknown, or the file cannot be written.

    Example:
        >>> from pathlib import Path
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.batch import ClusterSettings
        >>> from grasp3d.physics import SimulationSettings, write_simulation
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.04, 0.06, 0.1]), unit="m")
        >>> settings = SimulationSettings(count=3, pull_time=0.1)
        >>> found = grasp3d.simulate_grasps(
        ...     box, simulation=settings, cluster=ClusterSettings(workers=0)
        ... )
        >>> write_simulation("simulated.csv", found)
        >>> len(Path("simulated.csv").read_text().splitlines())
        4
    """
    write_columns(Path(path), dict(found.columns()), settings=settings_of(found))


def settings_of(found: Simulation) -> dict[str, Any]:
    """The settings that a table stores; angles in radians."""
    simulation = plain_values(found.settings)
    return {
        "version": package_version(),
        **chosen_settings(found.mesh, found.model, None, "scan"),
        **{name: value for name, value in simulation.items() if name != "seed"},
        "simulation_seed": found.settings.seed,
        "parts": found.parts,
    }
