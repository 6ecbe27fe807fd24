"""Files of a robot package to frozen dataclasses; never imports pydrake."""
