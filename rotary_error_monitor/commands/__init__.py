"""The commands of the command line, one small file each: `add` describes its arguments, `run` carries it out."""
