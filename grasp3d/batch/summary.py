"""The rows of a batch, and their table."""

from typing import Any

from grasp3d.batch.row import Row
from grasp3d.system.tables import data_frame, table_of_records


class Summary(list[Row]):
    """Rows of a batch, one for each mesh, in the order of the meshes' names."""

    def to_table(self) -> Any:
        """Return a `pyarrow.Table` with the columns of the data set `summary/`."""
        return table_of_records(self, Row, {})

    def to_dataframe(self) -> Any:
        """Return `to_table` as a `pandas.DataFrame`.

        Raises:
            OutputError: pandas is not installed; the extra `grasp3d[pandas]` installs it.
        """
        return data_frame(self.to_table())
