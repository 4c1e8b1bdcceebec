"""One physical effect a file: its parameters and its law. Plants are assemblies of these."""
