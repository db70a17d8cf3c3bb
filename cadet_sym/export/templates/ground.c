/* The correlation G of the states with the ground between wheels on one track, node by node:
 *
 *     G_j' = N G_j - (V/h) (sum_i D_ji G_i + D_j0 G_in)
 *
 * N, V/h and what the wheels add to the inflow are `parts`, which the model's own equations give. */
#include "@p@_ground.h"

enum { SIZE = @P@_SIZE, STATES = @P@_STATES, HEAD = @P@_HEAD };

@tables@

static void multiply(int rows, int inner, int columns, const R *a, const R *b, R *product)
{
    for (int j = 0; j < columns; j++)
        for (int i = 0; i < rows; i++) {
            R sum = K(0.0);
            for (int k = 0; k < inner; k++)
                sum += a[k * rows + i] * b[j * inner + k];
            product[j * rows + i] = sum;
        }
}

/* The [7/7] Pade approximant, scaled and squared (Higham 2005). */
void @p@_carry(int r, const R *C, R d, int columns, R *x)
{
    static const R coefficients[8] = {K(17297280.0), K(8648640.0), K(1995840.0), K(277200.0), K(25200.0), K(1512.0),
                                      K(56.0), K(1.0)};
    R A[STATES * STATES], power[STATES * STATES], even[STATES * STATES], odd[STATES * STATES], column[STATES];
    R norm = K(0.0);
    int pivots[STATES], squarings = 0;
    for (int i = 0; i < r; i++) {
        R sum = K(0.0);
        for (int j = 0; j < r; j++)
            sum += M(fabs)(C[j * r + i] * d);
        norm = sum > norm ? sum : norm;
    }
    for (; norm > K(0.25) && squarings < 60; squarings++)
        norm /= K(2.0);
    for (int i = 0; i < r * r; i++) {
        A[i] = M(ldexp)(C[i] * d, -squarings);
        power[i] = i % (r + 1) == 0 ? K(1.0) : K(0.0);
        even[i] = coefficients[0] * power[i];
        odd[i] = K(0.0);
    }
    for (int k = 1; k < 8; k++) {
        R next[STATES * STATES];
        multiply(r, r, r, power, A, next);
        for (int i = 0; i < r * r; i++) {
            power[i] = next[i];
            if (k % 2)
                odd[i] += coefficients[k] * next[i];
            else
                even[i] += coefficients[k] * next[i];
        }
    }
    for (int i = 0; i < r * r; i++) {
        power[i] = even[i] + odd[i];
        even[i] -= odd[i];
    }
    @p@_decompose(r, even, pivots);
    for (int j = 0; j < r; j++)
        @p@_solve(r, even, pivots, power + j * r);
    for (; squarings > 0; squarings--) {
        multiply(r, r, r, power, power, even);
        for (int i = 0; i < r * r; i++)
            power[i] = even[i];
    }
    for (int j = 0; j < columns; j++) {
        multiply(r, r, 1, power, x + j * r, column);
        for (int i = 0; i < r; i++)
            x[j * r + i] = column[i];
    }
}

/* G = exp(N theta / V) (inflow), node by node. */
void @p@_travelled(R t, R s, R V, const R *p, R *y)
{
    R parts[@P@_PARTS], dy[SIZE], N[STATES * STATES];
    @p@_held_rate_parts(t, s, V, y, p, dy, parts);
    for (int i = 0; i < STATES * STATES; i++)
        N[i] = K(0.0);
    for (int k = 0; k < @P@_GAIN; k++)
        N[gain_column[k] * STATES + gain_row[k]] = parts[k];
    for (int g = 0; g < @P@_GAPS; g++) {
        const @p@_gap *gap = @p@_gaps + g;
        const int block = STATES * gap->columns;
        const R time = K(1.0) / parts[@P@_GAIN + g];
        for (int k = 0; k < gap->elements * gap->nodes; k++) {
            const int node = k % gap->nodes;
            R *G = y + gap->first + k * block;
            for (int i = 0; i < block; i++)
                G[i] = (k > 0 || gap->joined ? G[i - block] : K(0.0)) + (k > 0 ? K(0.0) : parts[gap->entering + i]);
            @p@_carry(STATES, N, time * (gap->places[node] - (node > 0 ? gap->places[node - 1] : K(0.0))),
                      gap->columns, G);
        }
    }
}

static int inflow_joins(const @p@_gap *gap, int element)
{
    return element > 0 || gap->joined;
}

/* sum_i D_ji G_i + D_j0 G_in for all nodes of a gap. */
static void differentiate(const @p@_gap *gap, const R *restrict y, const R *restrict entering, R *restrict slope)
{
    const int block = STATES * gap->columns, width = gap->nodes + 1;
    for (int e = 0; e < gap->elements; e++) {
        const int start = gap->first + e * gap->nodes * block;
        for (int j = 0; j < gap->nodes; j++) {
            const R *D = gap->derivative + j * width;
            R *into = slope + start + j * block;
            for (int i = 0; i < block; i++) {
                const R before = inflow_joins(gap, e) ? y[start - block + i] : K(0.0);
                into[i] = D[0] * (e == 0 ? before + entering[i] : before);
            }
            for (int m = 0; m < gap->nodes; m++)
                for (int i = 0; i < block; i++)
                    into[i] += D[m + 1] * y[start + m * block + i];
        }
    }
}

/* x becomes N v - speed x for every vector of a gap. */
static void transport(const @p@_gap *gap, const R *restrict N, R speed, const R *restrict v, R *restrict x)
{
    const int end = gap->first + gap->elements * gap->nodes * gap->columns * STATES;
    for (int start = gap->first; start < end; start += STATES) {
        R product[STATES] = {K(0.0)};
        for (int k = 0; k < @P@_GAIN; k++)
            product[gain_row[k]] += N[k] * v[start + gain_column[k]];
        for (int i = 0; i < STATES; i++)
            x[start + i] = product[i] - speed * x[start + i];
    }
}

static void rate_of_ground(const R *restrict y, const R *restrict parts, R *restrict dy)
{
    for (int g = 0; g < @P@_GAPS; g++) {
        differentiate(@p@_gaps + g, y, parts + @p@_gaps[g].entering, dy);
        transport(@p@_gaps + g, parts, parts[@P@_GAIN + g], y, dy);
    }
}

/* Place an entry of the Jacobian; its rows are in order. */
static void add(R *values, int row, int column, R x)
{
    int low = @p@_jacobian_column[column], high = @p@_jacobian_column[column + 1] - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (@p@_jacobian_row[middle] < row)
            low = middle + 1;
        else
            high = middle;
    }
    values[low] += x;
}

/* Entries that do not come from the parts' own derivatives: N, and the transport from node to node. */
static void add_transport(const @p@_gap *gap, const R *restrict N, R speed, R *restrict values)
{
    const int block = STATES * gap->columns, width = gap->nodes + 1;
    for (int e = 0; e < gap->elements; e++)
        for (int j = 0; j < gap->nodes; j++) {
            const int start = gap->first + (e * gap->nodes + j) * block;
            for (int q = 0; q < gap->columns; q++)
                for (int k = 0; k < @P@_GAIN; k++)
                    add(values, start + q * STATES + gain_row[k], start + q * STATES + gain_column[k], N[k]);
            for (int m = inflow_joins(gap, e) ? -1 : 0; m < gap->nodes; m++)
                for (int i = 0; i < block; i++)
                    add(values, start + i, start + (m - j) * block + i,
                        -speed * gap->derivative[j * width + m + 1]);
        }
}

/* What one derivative of one part, d parts[part] / d y[column] = x, brings to the rates of a gap. */
static void add_part(int g, int part, int column, R x, const R *restrict y, const R *restrict slope, R speed,
                     R *restrict values)
{
    const @p@_gap *gap = @p@_gaps + g;
    const int block = STATES * gap->columns, end = gap->first + gap->elements * gap->nodes * block;
    if (part < @P@_GAIN)
        for (int start = gap->first; start < end; start += STATES)
            add(values, start + gain_row[part], column, x * y[start + gain_column[part]]);
    else if (part == @P@_GAIN + g)
        for (int i = gap->first; i < end; i++)
            add(values, i, column, -x * slope[i]);
    else if (part >= gap->entering && part < gap->entering + block)
        for (int j = 0; j < gap->nodes; j++)
            add(values, gap->first + j * block + part - gap->entering, column,
                -speed * gap->derivative[j * (gap->nodes + 1)] * x);
}

static void jacobian_of_ground(const R *restrict y, const R *restrict parts, const R *restrict own,
                            const R *restrict of_parts, R *restrict values)
{
    R slope[SIZE];
    for (int k = 0; k < @P@_NONZEROS; k++)
        values[k] = K(0.0);
    for (int j = 0; j < SIZE; j++)
        for (int k = own_column[j]; k < own_column[j + 1]; k++)
            values[@p@_jacobian_column[j] + k - own_column[j]] = own[k];
    for (int g = 0; g < @P@_GAPS; g++) {
        const R speed = parts[@P@_GAIN + g];
        differentiate(@p@_gaps + g, y, parts + @p@_gaps[g].entering, slope);
        add_transport(@p@_gaps + g, parts, speed, values);
        for (int k = 0; k < @of_parts@; k++)
            add_part(g, part_row[k], part_column[k], of_parts[k], y, slope, speed, values);
    }
}

void @p@_rate(R t, const R *restrict y, const R *restrict p, R *restrict dy)
{
    R parts[@P@_PARTS];
    @p@_rate_parts(t, y, p, dy, parts);
    rate_of_ground(y, parts, dy);
}

void @p@_held_rate(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict dy)
{
    R parts[@P@_PARTS];
    @p@_held_rate_parts(t, s, V, y, p, dy, parts);
    rate_of_ground(y, parts, dy);
}

void @p@_jacobian(R t, const R *restrict y, const R *restrict p, R *restrict values)
{
    R parts[@P@_PARTS], dy[SIZE], own[@own@], of_parts[@of_parts@ > 0 ? @of_parts@ : 1];
    @p@_rate_parts(t, y, p, dy, parts);
    @p@_jacobian_parts(t, y, p, own, of_parts);
    jacobian_of_ground(y, parts, own, of_parts, values);
}

void @p@_held_jacobian(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict values)
{
    R parts[@P@_PARTS], dy[SIZE], own[@own@], of_parts[@of_parts@ > 0 ? @of_parts@ : 1];
    @p@_held_rate_parts(t, s, V, y, p, dy, parts);
    @p@_held_jacobian_parts(t, s, V, y, p, own, of_parts);
    jacobian_of_ground(y, parts, own, of_parts, values);
}

void @p@_slope(R t, const R *restrict y, const R *restrict p, R *restrict slope)
{
    R parts[@P@_PARTS], change[@P@_PARTS], dy[SIZE];
    @p@_rate_parts(t, y, p, dy, parts);
    @p@_slope_parts(t, y, p, slope, change);
    for (int g = 0; g < @P@_GAPS; g++) {
        const @p@_gap *gap = @p@_gaps + g;
        const int block = STATES * gap->columns;
        differentiate(gap, y, parts + gap->entering, slope);
        transport(gap, change, change[@P@_GAIN + g], y, slope);
        for (int j = 0; j < gap->nodes; j++)
            for (int i = 0; i < block; i++)
                slope[gap->first + j * block + i] -=
                    parts[@P@_GAIN + g] * gap->derivative[j * (gap->nodes + 1)] * change[gap->entering + i];
    }
}
