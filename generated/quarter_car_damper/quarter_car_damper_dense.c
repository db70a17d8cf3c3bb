/* Linear systems with the Jacobian, as full matrices. */
#include "quarter_car_damper_real.h"

enum { SIZE = QUARTER_CAR_DAMPER_SIZE };

int quarter_car_damper_factorise(const R *values, R factor, const R *diagonal, quarter_car_damper_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    quarter_car_damper_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return quarter_car_damper_decompose(SIZE, factors->matrix, factors->pivots);
}

void quarter_car_damper_backsolve(const quarter_car_damper_factors *factors, R *x)
{
    quarter_car_damper_solve(SIZE, factors->matrix, factors->pivots, x);
}
