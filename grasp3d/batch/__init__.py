"""Many meshes: plan the jobs, run them in processes, store one row for each."""
