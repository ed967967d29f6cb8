"""How many threads numpy's linear algebra may use; nothing here may import numpy."""

#: environment: with matrices as small as ours, and eight processes on the cores, threads of BLAS
#: only stand in each other's way
ONE_THREAD = {'OMP_NUM_THREADS': '1', 'OPENBLAS_NUM_THREADS': '1'}
