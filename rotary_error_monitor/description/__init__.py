"""What people write down about a stage, a machine and the wire, read into frozen dataclasses."""
