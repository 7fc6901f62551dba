"""Replication of Sheu and Walker (1991)."""
