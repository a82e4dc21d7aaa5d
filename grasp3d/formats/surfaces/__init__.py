"""Files of labelled surfaces: PLY and NPZ, which are read again, VTP, Parquet and GLB."""
