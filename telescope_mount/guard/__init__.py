"""What a mount may be told: limits, and the check of a commanded track before it is sent."""
