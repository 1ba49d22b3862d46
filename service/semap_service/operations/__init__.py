"""What those see who run semap: logs, metrics, traces, readiness, and what the doctor finds."""
