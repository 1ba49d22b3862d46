"""What those see who run semap: request ids, logs, metrics, traces, readiness, and what the doctor finds."""
