"""The command ``completion``."""

SHELLS = ('bash', 'zsh', 'fish')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'completion', help='have a shell complete commands, options and names',
        description='Print what makes a shell complete commands, options, names of scenarios and '
        'files: eval "$(telescope-mount completion bash)" in ~/.bashrc, or the same with zsh in '
        '~/.zshrc after compinit; for fish redirect it to '
        '~/.config/fish/completions/telescope-mount.fish.')
    parser.add_argument('shell', choices=SHELLS)


def run(args):
    """Print."""
    import argcomplete
    print(argcomplete.shellcode(['telescope-mount'], shell=args.shell))
