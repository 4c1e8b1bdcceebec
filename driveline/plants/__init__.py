"""Plants: assemblies of the same elements, run by the same step function."""
