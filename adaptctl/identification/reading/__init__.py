"""Readers of logs: delimited text, Parquet, and ROS bags."""
