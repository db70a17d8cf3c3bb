/* Full linear systems, and the Jacobian as one. */
#include "quarter_car_damper_real.h"

enum { SIZE = QUARTER_CAR_DAMPER_SIZE };

int quarter_car_damper_covariance(int i, int j)
{
    const int row = i > j ? i : j, column = i > j ? j : i;
    return QUARTER_CAR_DAMPER_STATES + column * QUARTER_CAR_DAMPER_STATES - column * (column - 1) / 2 + row - column;
}

void quarter_car_damper_add_jacobian(const R *values, R factor, R *matrix)
{
    for (int j = 0; j < SIZE; j++)
        for (int k = quarter_car_damper_jacobian_column[j]; k < quarter_car_damper_jacobian_column[j + 1]; k++)
            matrix[j * SIZE + quarter_car_damper_jacobian_row[k]] += factor * values[k];
}

void quarter_car_damper_jacobian_dense(R t, const R *restrict y, const R *restrict p, R *restrict matrix)
{
    /* the values first fill the end of the matrix: in order, so that none is overwritten before it is read */
    R *values = matrix + SIZE * SIZE - QUARTER_CAR_DAMPER_NONZEROS;
    int k = 0;
    quarter_car_damper_jacobian(t, y, p, values);
    for (int j = 0; j < SIZE; j++)
        for (int i = 0; i < SIZE; i++) {
            const int here = k < quarter_car_damper_jacobian_column[j + 1] && quarter_car_damper_jacobian_row[k] == i;
            matrix[j * SIZE + i] = here ? values[k] : K(0.0);
            k += here;
        }
}

int quarter_car_damper_decompose(int n, R *matrix, int *pivots)
{
    for (int k = 0; k < n; k++) {
        R *column = matrix + k * n;
        int best = k;
        for (int i = k + 1; i < n; i++)
            if (M(fabs)(column[i]) > M(fabs)(column[best]))
                best = i;
        pivots[k] = best;
        if (!(M(fabs)(column[best]) > K(0.0)) || !FINITE(column[best]))
            return 0;
        if (best != k)
            for (int j = 0; j < n; j++) {
                const R other = matrix[j * n + k];
                matrix[j * n + k] = matrix[j * n + best];
                matrix[j * n + best] = other;
            }
        const R inverse = K(1.0) / column[k];
        for (int i = k + 1; i < n; i++)
            column[i] *= inverse;
        for (int j = k + 1; j < n; j++) {
            R *right = matrix + j * n;
            const R factor = right[k];
            if (factor != K(0.0))
                for (int i = k + 1; i < n; i++)
                    right[i] -= factor * column[i];
        }
    }
    return 1;
}

void quarter_car_damper_solve(int n, const R *matrix, const int *pivots, R *x)
{
    for (int k = 0; k < n; k++) {
        const R value = x[pivots[k]];
        x[pivots[k]] = x[k];
        x[k] = value;
    }
    for (int k = 0; k < n; k++)
        for (int i = k + 1; i < n; i++)
            x[i] -= matrix[k * n + i] * x[k];
    for (int k = n - 1; k >= 0; k--) {
        x[k] /= matrix[k * n + k];
        for (int i = 0; i < k; i++)
            x[i] -= matrix[k * n + i] * x[k];
    }
}

const char *quarter_car_damper_status_text(quarter_car_damper_status status)
{
    static const char *const texts[] = {
        "done",
        "too many steps: use the stiff method, or a wider tolerance",
        "the step became too small: the moments grow without bound, or the tolerance is below rounding",
        "a rate is not a number: check the parameters and the start",
        "a linear system is singular: a state, or a combination of states, drifts and has no stationary moments",
        "no stationary moments were found from this start",
        "what was found is not a covariance",
    };
    return texts[status];
}
