"""The solidity room."""
