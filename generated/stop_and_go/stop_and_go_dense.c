/* Linear systems with the Jacobian, as full matrices. */
#include "stop_and_go_real.h"

enum { SIZE = STOP_AND_GO_SIZE };

int stop_and_go_factorise(const R *values, R factor, const R *diagonal, stop_and_go_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    stop_and_go_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return stop_and_go_decompose(SIZE, factors->matrix, factors->pivots);
}

void stop_and_go_backsolve(const stop_and_go_factors *factors, R *x)
{
    stop_and_go_solve(SIZE, factors->matrix, factors->pivots, x);
}
