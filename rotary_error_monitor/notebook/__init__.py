"""A Python API for notebooks: recordings read, estimated, analysed and diagnosed, as arrays, tables and figures."""
