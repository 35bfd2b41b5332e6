"""Digital twins: what a recording should have shown, given what is known and the effects that are assumed."""
