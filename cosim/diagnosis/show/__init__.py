"""What is wrong with a simulation, in an engineer's words."""
