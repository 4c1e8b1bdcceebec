"""Everything that opens an FMU or looks at data: master, scenarios, measurements, plots, command line."""
