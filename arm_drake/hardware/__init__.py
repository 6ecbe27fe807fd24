"""Hardware of a robot in simulation: drives, servos, friction, wheels, mirrors."""
