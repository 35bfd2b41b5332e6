"""A kind of sensor of one's own: a displacement probe that looks at a master ball at an angle to the plane."""
