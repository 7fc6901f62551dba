"""Replication of Sheu and Walker (1991): what is printed, what is computed, what is judged, and how it is shown."""
