/* Linear systems with the Jacobian, as full matrices. */
#include "van_der_pol_real.h"

enum { SIZE = VAN_DER_POL_SIZE };

int van_der_pol_factorise(const R *values, R factor, const R *diagonal, van_der_pol_factors *factors)
{
    for (int i = 0; i < SIZE * SIZE; i++)
        factors->matrix[i] = K(0.0);
    van_der_pol_add_jacobian(values, factor, factors->matrix);
    for (int i = 0; i < SIZE; i++)
        factors->matrix[i * SIZE + i] += diagonal[i];
    return van_der_pol_decompose(SIZE, factors->matrix, factors->pivots);
}

void van_der_pol_backsolve(const van_der_pol_factors *factors, R *x)
{
    van_der_pol_solve(SIZE, factors->matrix, factors->pivots, x);
}
