/* What bindgen reads: the eigenvalue solver pulls in PETSc's matrices, solvers and vectors. */
#include <slepceps.h>
