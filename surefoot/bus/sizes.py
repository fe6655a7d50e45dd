"""Largest messages that are accepted; a module of its own, so that Zenoh's options do without the schemas."""

MAX_JSON_BYTES = 1 << 20
"""Largest JSON payload of a message, bytes; a larger one is refused."""

MAX_BULK_BYTES = 64 << 20
"""Largest raw array of a message, bytes, which a 4096 x 4096 float32 map fills; a larger one is refused."""
