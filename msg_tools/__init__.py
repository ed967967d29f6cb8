"""The boundary: ROS messages to arrays, MCAP logs, and files of pointing runs."""

#: where the graph lives unless it is started elsewhere
NAMESPACE = '/mount'
