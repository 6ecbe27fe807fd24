"""What a person sees and moves in the browser: a robot, a simulation, a log."""
