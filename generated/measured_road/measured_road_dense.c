/* Linear systems with the Jacobian, as full matrices. */
#include "measured_road_real.h"

enum { SIZE = MEASURED_ROAD_SIZE };

int measured_road_factorise(const R *values, R factor, const R *diagonal, measured_road_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    measured_road_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return measured_road_decompose(SIZE, factors->matrix, factors->pivots);
}

void measured_road_backsolve(const measured_road_factors *factors, R *x)
{
    measured_road_solve(SIZE, factors->matrix, factors->pivots, x);
}
