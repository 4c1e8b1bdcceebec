"""The report of a diagnosis: one self-contained page that is understood in a minute."""
