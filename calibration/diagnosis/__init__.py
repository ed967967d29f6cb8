"""What a declared model lacks: candidates, their scores, chance, cross-validation, the verdict."""

from .base import Base
from .diagnosis import diagnose
from .input_check import MistakenColumns, check_columns, naming_columns
from .result import DiagnosedEffect, Diagnosis

__all__ = ['Base', 'DiagnosedEffect', 'Diagnosis', 'MistakenColumns', 'check_columns', 'diagnose',
           'naming_columns']
