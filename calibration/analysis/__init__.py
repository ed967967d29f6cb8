"""What the rows of a run, a night or a season say of a mount."""
