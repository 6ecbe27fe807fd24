"""Pictures of a rollout, one module for each kind; `visualization/plot.py` is the door.

They import matplotlib, so that who draws nothing must not import them. None uses
pyplot: a picture belongs to who asked for it, and needs no window.
"""
