"""The control law and its gains: chosen on the identified axis, or shaped on a measured response."""
