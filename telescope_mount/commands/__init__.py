"""The commands of `telescope-mount`, a file each: its options, what it does, what it prints.

Each has ``add(commands)``, which adds its parser, and ``run(args)``, which gives the exit code or
None. What costs time to import is imported in ``run``.
"""

#: modules in the order of the help
COMMANDS = ('night', 'observe', 'watch', 'check_drivers', 'guard', 'lifecycle', 'experiment',
            'close_the_loop', 'solve', 'fit', 'diagnose', 'bolts', 'track', 'passes', 'satellite',
            'season', 'zeros', 'apply', 'export', 'info', 'recover', 'verify', 'replay',
            'encoder_test', 'completion')
#: where those are that show what the papers did
PAPERS = {name: f'papers.{name}_command' for name in ('experiment', 'encoder_test')}
