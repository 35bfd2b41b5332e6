"""The noise of instruments and rotor: what it is like, how rows become white, where samples are missing."""
