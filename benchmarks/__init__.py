"""Timings and long comparisons: printed, never asserted."""
