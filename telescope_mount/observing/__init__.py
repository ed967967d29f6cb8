"""How a night is observed: the plan, its steps, the stars, readings and exposures. No ROS."""
