"""Numerics below the physics: how functions are compiled, random numbers."""
