"""What the gate measures: accuracy, and instructions of a step."""
