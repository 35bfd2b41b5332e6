"""Names of the streams of which a stage has one each: as their section in its file, or as what they show."""

AUTOCOLLIMATOR = "autocollimator"
OWN_REFERENCE = "lvdt"
"""Of the displacement sensor of two axes that radial error motion is compared with: no estimate rests on it."""

TWO_AXIS = (AUTOCOLLIMATOR, OWN_REFERENCE)
"""Of instruments that answer as `Response` says, each with a section of its own."""

REFERENCE_TITLE = "LVDT"
"""What people call the stage's own reference."""

COMMAND = "command"
FORCE = "force"
"""Of the load cell that has a topic of its own."""

TEMPERATURE = "temperature"
"""Of the stage."""
