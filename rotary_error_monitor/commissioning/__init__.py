"""From a recording of a newly built stage to its stage file: what is there, what is wrong, what was found."""
