"""From a measurement to what is wrong, why, and a model that has it right."""
