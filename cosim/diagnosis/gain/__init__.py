"""The extended vehicle file and FMU, and what they gain."""
