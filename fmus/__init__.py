"""Shells that show a driveline model as an FMI 2.0 co-simulation slave, and the builder of the FMUs."""
