"""How many files a process may have open: ROS says nothing of use where they do not suffice."""

import resource

#: that a node or a command needs, libraries that it loads among them; half as many sufficed
NEEDED = 64


def check_open_files():
    """Refuse to begin what would fail on the way.

    Raises
    ------
    ValueError
        The limit is too small.
    """
    limit = resource.getrlimit(resource.RLIMIT_NOFILE)[0]
    if limit != resource.RLIM_INFINITY and limit < NEEDED:
        raise ValueError(f'only {limit} files may be open in a process; ROS needs {NEEDED}: '
                         'ulimit -n 1024')
