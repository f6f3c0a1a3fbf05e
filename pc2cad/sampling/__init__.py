"""Points of the interior, and the map inverted: which parameters a point of space has."""
