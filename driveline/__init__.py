"""Physics and estimators: no FMI, no files but the vehicle's, no plots. Ships inside every FMU."""
