"""From the rows of a log to short vectors: coordinate and motion, repetitions, residual channels, the healthy
spread."""
