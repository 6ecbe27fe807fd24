"""Types of arrays."""

import numpy as np
from numpy.typing import NDArray

# Numbers of any shape; docstrings say which.
Array = NDArray[np.float64]
