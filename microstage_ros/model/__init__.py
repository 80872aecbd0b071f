"""The machine as mathematics: axis files, friction laws, effects, sensors, and the record that they fill in."""
