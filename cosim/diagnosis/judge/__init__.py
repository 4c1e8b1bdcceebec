"""What is said of what was found: confirmed or not, where something is missing, what would tell causes apart."""
