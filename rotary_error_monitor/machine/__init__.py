"""The multi-body model of a machine: ideal motion, errors, tool minus workpiece, corrections."""
