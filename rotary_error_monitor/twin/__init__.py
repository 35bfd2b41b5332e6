"""Digital twins: nominal model, effects and inputs to predicted signals."""
