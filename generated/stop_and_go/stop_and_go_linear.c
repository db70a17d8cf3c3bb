/* Full linear systems, and the Jacobian as one. */
#include "stop_and_go_real.h"

enum { SIZE = STOP_AND_GO_SIZE };

int stop_and_go_covariance(int i, int j)
{
    const int row = i > j ? i : j, column = i > j ? j : i;
    return STOP_AND_GO_STATES + column * STOP_AND_GO_STATES - column * (column - 1) / 2 + row - column;
}

void stop_and_go_add_jacobian(const R *values, R factor, R *matrix)
{
    for (int j = 0; j < SIZE; j++)
        for (int k = stop_and_go_jacobian_column[j]; k < stop_and_go_jacobian_column[j + 1]; k++)
            matrix[j * SIZE + stop_and_go_jacobian_row[k]] += factor * values[k];
}

void stop_and_go_jacobian_dense(R t, const R *restrict y, const R *restrict p, R *restrict matrix)
{
    /* the values first fill the end of the matrix: in order, so that none is overwritten before it is read */
    R *values = matrix + SIZE * SIZE - STOP_AND_GO_NONZEROS;
    int k = 0;
    stop_and_go_jacobian(t, y, p, values);
    for (int j = 0; j < SIZE; j++)
        for (int i = 0; i < SIZE; i++) {
            const int here = k < stop_and_go_jacobian_column[j + 1] && stop_and_go_jacobian_row[k] == i;
            matrix[j * SIZE + i] = here ? values[k] : K(0.0);
            k += here;
        }
}

int stop_and_go_decompose(int n, R *matrix, int *pivots)
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

void stop_and_go_solve(int n, const R *matrix, const int *pivots, R *x)
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

const char *stop_and_go_status_text(stop_and_go_status status)
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
