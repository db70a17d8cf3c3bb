/* Linear systems with the Jacobian, as full matrices. */
#include "road_class_change_real.h"

enum { SIZE = ROAD_CLASS_CHANGE_SIZE };

int road_class_change_factorise(const R *values, R factor, const R *diagonal, road_class_change_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    road_class_change_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return road_class_change_decompose(SIZE, factors->matrix, factors->pivots);
}

void road_class_change_backsolve(const road_class_change_factors *factors, R *x)
{
    road_class_change_solve(SIZE, factors->matrix, factors->pivots, x);
}
