/* Linear systems with the Jacobian, as full matrices. */
#include "oleo_constant_speed_real.h"

enum { SIZE = OLEO_CONSTANT_SPEED_SIZE };

int oleo_constant_speed_factorise(const R *values, R factor, const R *diagonal, oleo_constant_speed_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    oleo_constant_speed_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return oleo_constant_speed_decompose(SIZE, factors->matrix, factors->pivots);
}

void oleo_constant_speed_backsolve(const oleo_constant_speed_factors *factors, R *x)
{
    oleo_constant_speed_solve(SIZE, factors->matrix, factors->pivots, x);
}
