"""Names of the streams of which a stage has one each: as their section in its file, or as what they show."""

AUTOCOLLIMATOR = "autocollimator"
LVDT = "lvdt"
COMMAND = "command"
FORCE = "force"
"""Of the load cell that has a topic of its own."""

TEMPERATURE = "temperature"
"""Of the stage."""
