"""Physical effects that a twin may lack: one small class each, one shape for all."""
