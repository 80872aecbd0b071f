"""From the records of a commissioning to the axis: frequency responses, plant, parameters with uncertainty."""
