"""Physical effects that a digital twin may lack: one small class each, found because it is defined here."""
