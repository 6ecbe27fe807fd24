"""A campaign of mutated inputs: none ends in a traceback, or takes all there is.

`python -m tests.fuzz --seconds 600` runs one; so does `make fuzz`.
"""
