"""How a step function written in plain Python becomes a compiled one.

``backend`` marks the functions, ``native`` builds, loads and binds them, ``compiler`` is the only
file that needs Numba and never runs where an FMU runs.
"""
