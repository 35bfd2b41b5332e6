"""One way through the house: samples to error motion, error motion to tool offset, offset to axis corrections."""
