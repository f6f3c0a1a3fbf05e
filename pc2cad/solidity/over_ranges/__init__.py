"""What of a map is proved for all values of some parameters, found by halving their ranges."""
