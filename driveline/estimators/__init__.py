"""Estimators of the backlash state and size, and the linear models they stand on."""
