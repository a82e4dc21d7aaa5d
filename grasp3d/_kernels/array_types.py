"""Array types of the kernels, as annotations and as Numba compiles them.

The number at the end of a name is that of the dimensions; arrays are C-contiguous. Numba compiles a
kernel separately for arrays that cannot be written, as those of a mesh and of contacts: their names
begin with Fixed.
"""

from typing import Annotated

import numpy as np
import numpy.typing as npt
from numba.core import types

from grasp3d.arrays import Bools, Bytes, Floats, Ints


def _array(item: types.Type, ndim: int, *, fixed: bool = False) -> types.Array:
    return types.Array(item, ndim, "C", readonly=fixed)


Floats1 = Annotated[Floats, _array(types.float64, 1)]
Floats2 = Annotated[Floats, _array(types.float64, 2)]
Floats3 = Annotated[Floats, _array(types.float64, 3)]
Floats4 = Annotated[Floats, _array(types.float64, 4)]
FixedFloats1 = Annotated[Floats, _array(types.float64, 1, fixed=True)]
FixedFloats2 = Annotated[Floats, _array(types.float64, 2, fixed=True)]
FixedFloats3 = Annotated[Floats, _array(types.float64, 3, fixed=True)]
Ints1 = Annotated[Ints, _array(types.int64, 1)]
Ints2 = Annotated[Ints, _array(types.int64, 2)]
Ints3 = Annotated[Ints, _array(types.int64, 3)]
FixedInts1 = Annotated[Ints, _array(types.int64, 1, fixed=True)]
FixedInts2 = Annotated[Ints, _array(types.int64, 2, fixed=True)]
Bools1 = Annotated[Bools, _array(types.boolean, 1)]
Bools2 = Annotated[Bools, _array(types.boolean, 2)]
Bytes1 = Annotated[Bytes, _array(types.uint8, 1)]
Float32s1 = Annotated[npt.NDArray[np.float32], _array(types.float32, 1)]
Float32s2 = Annotated[npt.NDArray[np.float32], _array(types.float32, 2)]
Float32s3 = Annotated[npt.NDArray[np.float32], _array(types.float32, 3)]
Int8s1 = Annotated[npt.NDArray[np.int8], _array(types.int8, 1)]
Int8s2 = Annotated[npt.NDArray[np.int8], _array(types.int8, 2)]
Int32s1 = Annotated[npt.NDArray[np.int32], _array(types.int32, 1)]
Int32s3 = Annotated[npt.NDArray[np.int32], _array(types.int32, 3)]
UInt32s1 = Annotated[npt.NDArray[np.uint32], _array(types.uint32, 1)]
UInt32s2 = Annotated[npt.NDArray[np.uint32], _array(types.uint32, 2)]
UInt64s1 = Annotated[npt.NDArray[np.uint64], _array(types.uint64, 1)]
