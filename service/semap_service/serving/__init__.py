"""The application put together, described, and run by uvicorn."""
