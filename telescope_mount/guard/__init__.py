"""What a mount may be told: limits, and the judgement of a commanded track before it is sent."""
