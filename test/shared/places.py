"""Where things are that tests read."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
#: measured runs and small inputs beside the project, where they are there
DATA, CASES = ROOT.parent / 'shared' / 'data', ROOT.parent / 'shared' / 'cases'
LOG = ROOT / 'test' / 'data' / 'sample_log'
