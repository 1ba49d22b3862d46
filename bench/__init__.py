"""Benchmarks: every figure that the documentation states is measured here. Run with ./dev bench."""
