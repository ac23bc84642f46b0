"""What ``float()`` or NumPy takes for a number, though nobody means one by it."""

import numpy as np

NO_NUMBERS = (str, bytes, bool, np.bool_, np.datetime64, np.timedelta64, np.complexfloating)
