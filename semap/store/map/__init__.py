"""The map: its concepts, frames, descriptions and instances, their history, and what is asked of them."""
