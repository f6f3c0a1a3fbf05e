"""Readers of the written files that share nothing with the compiler under test."""
