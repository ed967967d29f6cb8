"""The boundary: ROS messages to arrays, MCAP logs, what nodes share."""

#: where the graph lives unless it is started elsewhere
NAMESPACE = '/mount'
