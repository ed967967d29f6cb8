"""The terms of a mount night by night: how they drift, what moves them, what tonight's will be."""
