"""One picture of a run, from its messages: what the report, the live view, `render` and the Foxglove export show."""
