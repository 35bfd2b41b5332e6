"""The true world of mocks and benchmarks: exact geometry that shares no formula with twin and estimator."""
