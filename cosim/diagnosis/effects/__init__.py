"""One effect a file: ``EFFECT``, and what it is physically in the docstring. The name is the file's."""
