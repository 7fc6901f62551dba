"""Excitation of parameters by motions."""
