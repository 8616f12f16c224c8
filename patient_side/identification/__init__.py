"""From a recorded movement to a model of the arm: past-output MOESP, order, noise, forecast of its input."""
