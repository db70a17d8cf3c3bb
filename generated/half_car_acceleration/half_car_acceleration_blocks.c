/* Linear systems with the Jacobian, block by block: the ground between wheels element by element, then the rest. */
#include "half_car_acceleration_ground.h"

enum { SIZE = HALF_CAR_ACCELERATION_SIZE, HEAD = HALF_CAR_ACCELERATION_HEAD, ACTIVE = HALF_CAR_ACCELERATION_ACTIVE, GROUND = ACTIVE - HEAD };

/* x becomes (block of the ground)^-1 x; every element sees itself and what leaves the one in front. */
static void solve_ground(const half_car_acceleration_factors *factors, R *x)
{
    const R *blocks = factors->blocks;
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
        const int block = HALF_CAR_ACCELERATION_ROWS * gap->columns, count = gap->modes * block;
        for (int e = 0; e < gap->elements; e++, blocks += count * count) {
            const int first = gap->first + e * count;
            for (int j = e > 0 || gap->joined ? first - block : first; j < first; j++)
                for (int k = half_car_acceleration_jacobian_column[j]; k < half_car_acceleration_jacobian_column[j + 1]; k++)
                    if (half_car_acceleration_jacobian_row[k] >= first)
                        x[half_car_acceleration_jacobian_row[k] - HEAD] -= factors->values[k] * x[j - HEAD];
            half_car_acceleration_solve(count, blocks, factors->pivots + first, x + first - HEAD);
        }
    }
}

/* y -= (what the ground adds to the rest) x. */
static void subtract_ground(const half_car_acceleration_factors *factors, const R *x, R *y)
{
    for (int j = HEAD; j < ACTIVE; j++)
        for (int k = half_car_acceleration_jacobian_column[j]; k < half_car_acceleration_jacobian_column[j + 1] && half_car_acceleration_jacobian_row[k] < HEAD; k++)
            y[half_car_acceleration_jacobian_row[k]] -= factors->values[k] * x[j - HEAD];
}

static int factorise_ground(const R *diagonal, half_car_acceleration_factors *factors)
{
    R *blocks = factors->blocks;
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
        const int count = gap->modes * HALF_CAR_ACCELERATION_ROWS * gap->columns;
        for (int e = 0; e < gap->elements; e++, blocks += count * count) {
            const int first = gap->first + e * count;
            for (int i = 0; i < count * count; i++)
                blocks[i] = K(0.0);
            for (int j = first; j < first + count; j++) {
                blocks[(j - first) * (count + 1)] = diagonal[j];
                for (int k = half_car_acceleration_jacobian_column[j]; k < half_car_acceleration_jacobian_column[j + 1]; k++)
                    if (half_car_acceleration_jacobian_row[k] >= first && half_car_acceleration_jacobian_row[k] < first + count)
                        blocks[(j - first) * count + half_car_acceleration_jacobian_row[k] - first] += factors->values[k];
            }
            if (!half_car_acceleration_decompose(count, blocks, factors->pivots + first))
                return 0;
        }
    }
    return 1;
}

int half_car_acceleration_factorise(const R *values, R factor, const R *diagonal, half_car_acceleration_factors *factors)
{
    for (int k = 0; k < HALF_CAR_ACCELERATION_NONZEROS; k++)
        factors->values[k] = factor * values[k];
    if (!factorise_ground(diagonal, factors))
        return 0;
    for (int j = 0; j < HEAD; j++) {
        R *column = factors->head + j * HEAD, *across = factors->across + j * GROUND;
        factors->coupled[j] = 0;
        for (int i = 0; i < HEAD; i++)
            column[i] = i == j ? diagonal[j] : K(0.0);
        for (int i = 0; i < GROUND; i++)
            across[i] = K(0.0);
        for (int k = half_car_acceleration_jacobian_column[j]; k < half_car_acceleration_jacobian_column[j + 1]; k++) {
            const int row = half_car_acceleration_jacobian_row[k];
            if (row < HEAD)
                column[row] += factors->values[k];
            else
                across[row - HEAD] = factors->values[k];
            factors->coupled[j] = factors->coupled[j] || row >= HEAD;
        }
        if (factors->coupled[j]) {
            solve_ground(factors, across);
            subtract_ground(factors, across, column);
        }
    }
    return half_car_acceleration_decompose(HEAD, factors->head, factors->pivots);
}

void half_car_acceleration_backsolve(const half_car_acceleration_factors *factors, R *x)
{
    solve_ground(factors, x + HEAD);
    subtract_ground(factors, x + HEAD, x);
    half_car_acceleration_solve(HEAD, factors->head, factors->pivots, x);
    for (int j = 0; j < HEAD; j++)
        for (int i = 0; factors->coupled[j] && i < GROUND; i++)
            x[HEAD + i] -= factors->across[j * GROUND + i] * x[j];
    for (int i = ACTIVE; i < SIZE; i++)
        x[i] = K(0.0); /* what is known does not change */
}
