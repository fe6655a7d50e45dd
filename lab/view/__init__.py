"""Live view of a running system in a browser, with an HTTP server of the standard library and server-sent events."""
