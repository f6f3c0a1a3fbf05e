"""The topology room: which sides of the parameter box bound the solid, and how they meet.

It asks yes/no questions about the map and knows no coordinates.
"""
