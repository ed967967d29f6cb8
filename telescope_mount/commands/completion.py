"""The command ``completion``."""

SHELLS = ('bash', 'zsh', 'fish')


def add(commands):
    """Add the parser."""
    parser = commands.add_parser(
        'completion', help='have a shell complete commands, options and names',
        description='Print what makes a shell complete commands, options, names of scenarios and '
        'files. Bash: eval "$(telescope-mount completion bash)" in ~/.bashrc. Zsh: the same in '
        '~/.zshrc after compinit. Fish: redirect it to '
        '~/.config/fish/completions/telescope-mount.fish.')
    parser.add_argument('shell', choices=SHELLS)


def run(args):
    """Print."""
    import argcomplete
    print(argcomplete.shellcode(['telescope-mount'], shell=args.shell))
