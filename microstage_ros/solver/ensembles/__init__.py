"""Many axes at once: eight side by side in the lanes of two vectors."""
