"""Effects are hidden in measurements, the diagnosis gets the folder and nothing else, and is judged by the truth.

    python -m benchmarks.blind --cases 30 --workers 2

``cases`` says what is hidden, ``run`` lets the diagnosis loose on it, ``baselines`` are simpler methods on the
same cases. ``reading`` puts a finding beside the truth, ``figures`` are rates and medians beside targets,
``score`` is the table of them, ``failures`` tells what was not right.
"""

import os

# one thread for linear algebra in every process: sums in another order have other last bits, and results
# shall not depend on how many cases run side by side
for _name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_name, "1")
