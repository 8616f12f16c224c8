"""The vocabulary that all sides share; imports no other part of the testbed."""

import os

from tis import refuse_old_name

refuse_old_name(__name__)

# One BLAS thread, set before numpy loads: the matrices are small, real-time threads must not compete for cores,
# and a result must not depend on how many cores there are.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
os.environ.setdefault("MKL_NUM_THREADS", "1")
