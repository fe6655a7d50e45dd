"""Live view of a running system in a browser, by what Python brings: an HTTP server and server-sent events."""
