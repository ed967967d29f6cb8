"""The boundary: ROS messages to arrays, MCAP logs, what nodes share."""

#: where the graph lives unless it is started elsewhere
NAMESPACE = '/mount'


def version_of(package='telescope_mount'):
    """Version of a package; '' where it runs from a folder that is not installed."""
    from importlib.metadata import PackageNotFoundError, version
    try:
        return version(package)
    except PackageNotFoundError:
        return ''
