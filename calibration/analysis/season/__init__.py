"""The terms of a mount night by night: how they wander, what moves them, what tonight's will be."""
