/* Linear systems with the Jacobian, as full matrices. */
#include "duffing_real.h"

enum { SIZE = DUFFING_SIZE };

int duffing_factorise(const R *values, R factor, const R *diagonal, duffing_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    duffing_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return duffing_decompose(SIZE, factors->matrix, factors->pivots);
}

void duffing_backsolve(const duffing_factors *factors, R *x)
{
    duffing_solve(SIZE, factors->matrix, factors->pivots, x);
}
