"""Rules, the events that they make, and webhooks, to which events are sent."""
