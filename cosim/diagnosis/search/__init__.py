"""Which suppositions explain recordings best, of all causes, alone and together."""
