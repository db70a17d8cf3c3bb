/* Linear systems with the Jacobian, as full matrices. */
#include "oleo_acceleration_real.h"

enum { SIZE = OLEO_ACCELERATION_SIZE };

int oleo_acceleration_factorise(const R *values, R factor, const R *diagonal, oleo_acceleration_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    oleo_acceleration_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return oleo_acceleration_decompose(SIZE, factors->matrix, factors->pivots);
}

void oleo_acceleration_backsolve(const oleo_acceleration_factors *factors, R *x)
{
    oleo_acceleration_solve(SIZE, factors->matrix, factors->pivots, x);
}
