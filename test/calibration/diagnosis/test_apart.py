"""Causes told apart by stars that are asked for."""

import json

import numpy as np
import pytest
from diagnosis_simulated import FAST  # noqa: F401
