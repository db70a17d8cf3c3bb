/* Linear systems with the Jacobian, as full matrices. */
#include "@p@_real.h"

enum { SIZE = @P@_SIZE };

int @p@_factorise(const R *values, R factor, const R *diagonal, @p@_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    @p@_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return @p@_decompose(SIZE, factors->matrix, factors->pivots);
}

void @p@_backsolve(const @p@_factors *factors, R *x)
{
    @p@_solve(SIZE, factors->matrix, factors->pivots, x);
}
