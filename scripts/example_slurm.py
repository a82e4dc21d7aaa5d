"""Run a grasp3d command on SLURM jobs as workers, which are started here and end with the command.

    python scripts/example_slurm.py --jobs 16 --memory 8GB batch meshes -o results

Run it where jobs can be submitted; it needs dask-jobqueue, and this environment on every node.
"""

import argparse
import sys

from dask_jobqueue import SLURMCluster

from grasp3d.cli import main


def run(arguments: list[str]) -> int:
    """Start the cluster and run the command with its address; returns the command's exit code."""
    parser = argparse.ArgumentParser(description=__doc__, allow_abbrev=False)
    parser.add_argument("--jobs", type=int, default=4, help="SLURM jobs, one worker each")
    parser.add_argument("--memory", default="8GB", help="memory of each job")
    parser.add_argument("--walltime", default="08:00:00", help="time limit of each job")
    parser.add_argument("--queue", help="partition")
    parser.add_argument("--account", help="account that is charged")
    parser.add_argument("--interface", help="network of the nodes, such as ib0")
    parser.add_argument("command", nargs=argparse.REMAINDER, help="command of grasp3d")
    options = parser.parse_args(arguments)
    cluster = SLURMCluster(
        cores=1,
        processes=1,
        memory=options.memory,
        walltime=options.walltime,
        queue=options.queue,
        account=options.account,
        interface=options.interface,
        scheduler_options={"dashboard_address": ":0"},
    )
    with cluster:
        cluster.scale(jobs=options.jobs)
        return main([*options.command, "--scheduler", cluster.scheduler_address])


if __name__ == "__main__":
    sys.exit(run(sys.argv[1:]))
