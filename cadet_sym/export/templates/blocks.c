/* Linear systems with the Jacobian, block by block: the ground between wheels element by element, then the rest. */
#include "@p@_ground.h"

enum { SIZE = @P@_SIZE, HEAD = @P@_HEAD, ACTIVE = @P@_ACTIVE, GROUND = ACTIVE - HEAD };

/* x becomes (block of the ground)^-1 x; every element sees itself and what leaves the one in front. */
static void solve_ground(const @p@_factors *factors, R *x)
{
    const R *blocks = factors->blocks;
    for (int g = 0; g < @P@_GAPS; g++) {
        const @p@_gap *gap = @p@_gaps + g;
        const int block = @P@_ROWS * gap->columns, count = gap->modes * block;
        for (int e = 0; e < gap->elements; e++, blocks += count * count) {
            const int first = gap->first + e * count;
            for (int j = e > 0 || gap->joined ? first - block : first; j < first; j++)
                for (int k = @p@_jacobian_column[j]; k < @p@_jacobian_column[j + 1]; k++)
                    if (@p@_jacobian_row[k] >= first)
                        x[@p@_jacobian_row[k] - HEAD] -= factors->values[k] * x[j - HEAD];
            @p@_solve(count, blocks, factors->pivots + first, x + first - HEAD);
        }
    }
}

/* y -= (what the ground adds to the rest) x. */
static void subtract_ground(const @p@_factors *factors, const R *x, R *y)
{
    for (int j = HEAD; j < ACTIVE; j++)
        for (int k = @p@_jacobian_column[j]; k < @p@_jacobian_column[j + 1] && @p@_jacobian_row[k] < HEAD; k++)
            y[@p@_jacobian_row[k]] -= factors->values[k] * x[j - HEAD];
}

static int factorise_ground(const R *diagonal, @p@_factors *factors)
{
    R *blocks = factors->blocks;
    for (int g = 0; g < @P@_GAPS; g++) {
        const @p@_gap *gap = @p@_gaps + g;
        const int count = gap->modes * @P@_ROWS * gap->columns;
        for (int e = 0; e < gap->elements; e++, blocks += count * count) {
            const int first = gap->first + e * count;
            for (int i = 0; i < count * count; i++)
                blocks[i] = K(0.0);
            for (int j = first; j < first + count; j++) {
                blocks[(j - first) * (count + 1)] = diagonal[j];
                for (int k = @p@_jacobian_column[j]; k < @p@_jacobian_column[j + 1]; k++)
                    if (@p@_jacobian_row[k] >= first && @p@_jacobian_row[k] < first + count)
                        blocks[(j - first) * count + @p@_jacobian_row[k] - first] += factors->values[k];
            }
            if (!@p@_decompose(count, blocks, factors->pivots + first))
                return 0;
        }
    }
    return 1;
}

int @p@_factorise(const R *values, R factor, const R *diagonal, @p@_factors *factors)
{
    for (int k = 0; k < @P@_NONZEROS; k++)
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
        for (int k = @p@_jacobian_column[j]; k < @p@_jacobian_column[j + 1]; k++) {
            const int row = @p@_jacobian_row[k];
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
    return @p@_decompose(HEAD, factors->head, factors->pivots);
}

void @p@_backsolve(const @p@_factors *factors, R *x)
{
    solve_ground(factors, x + HEAD);
    subtract_ground(factors, x + HEAD, x);
    @p@_solve(HEAD, factors->head, factors->pivots, x);
    for (int j = 0; j < HEAD; j++)
        for (int i = 0; factors->coupled[j] && i < GROUND; i++)
            x[HEAD + i] -= factors->across[j * GROUND + i] * x[j];
    for (int i = ACTIVE; i < SIZE; i++)
        x[i] = K(0.0); /* what is known does not change */
}
