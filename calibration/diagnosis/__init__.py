"""What a declared model lacks: candidates, their scores, chance, cross-validation, the verdict."""

from .base import Base
from .diagnosis import DiagnosedEffect, Diagnosis, diagnose
from .streamed import diagnose_streamed

__all__ = ['Base', 'DiagnosedEffect', 'Diagnosis', 'diagnose', 'diagnose_streamed']
