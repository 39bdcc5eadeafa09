"""Pages and summaries: the report of a diagnosis, the pages of the components."""
