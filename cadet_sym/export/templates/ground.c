/* The correlation G of the states with the ground between wheels on one track, element by element:
 *
 *     a_i' = N a_i - slope_i,    slope_i = (V/h) (2 i + 1) (out - (-1)^i in - 2 (a_(i-1) + a_(i-3) + ...))
 *
 * with `out` for the last of these, whose slope is the sum of all. N, V/h and what the wheels add to the inflow are
 * `parts`, which the model's own equations give. */
#include "@p@_ground.h"

enum { SIZE = @P@_SIZE, STATES = @P@_STATES, ACTIVE = @P@_ACTIVE, ROWS = @P@_ROWS, COLUMNS = @columns@, MOVING = @moving@ };

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

static void gain_matrix(const R *parts, R *N)
{
    for (int i = 0; i < STATES * STATES; i++)
        N[i] = K(0.0);
    for (int k = 0; k < @P@_GAIN; k++)
        N[gain_column[k] * STATES + gain_row[k]] = parts[k];
}

void @p@_collocate(const @p@_gap *gap, int r, const R *C, R scale, R *tail, R *values)
{
    const int n = r * gap->modes, width = gap->modes + 1;
    R matrix[@P@_COLLOCATED * @P@_COLLOCATED];
    int pivots[@P@_COLLOCATED];
    for (int i = 0; i < n * n; i++)
        matrix[i] = K(0.0);
    for (int j = 0; j < gap->modes; j++)
        for (int i = 0; i < r; i++) {
            for (int m = 0; m < gap->modes; m++)
                matrix[(m * r + i) * n + j * r + i] += gap->derivative[j * width + m + 1];
            for (int k = 0; k < r; k++)
                matrix[(j * r + k) * n + j * r + i] -= scale * C[k * r + i];
        }
    @p@_decompose(n, matrix, pivots);
    for (int e = 0; e < gap->elements; e++, values += n) {
        for (int j = 0; j < gap->modes; j++)
            for (int i = 0; i < r; i++)
                values[j * r + i] = -gap->derivative[j * width] * tail[i];
        @p@_solve(n, matrix, pivots, values);
        for (int i = 0; i < r; i++)
            tail[i] = values[n - r + i];
    }
}

int @p@_ground_place(const @p@_gap *gap, int k, int q, int state)
{
    const int vector = k * gap->columns + q;
    if (state < ROWS)
        return gap->first + vector * ROWS + state;
    for (int j = 0; j < gap->known; j++)
        if (gap->known_states[j] == state)
            return gap->known_first + vector * gap->known + j;
    return -1;
}

void @p@_know_ground(R t, R s, const R *p, R *y)
{
    R parts[@P@_PARTS], dy[SIZE], N[STATES * STATES], C[STATES * STATES], tail[STATES], values[@P@_LONGEST];
    @p@_held_rate_parts(t, s, K(1.0), y, p, dy, parts);
    gain_matrix(parts, N);
    for (int g = 0; g < @P@_GAPS; g++) {
        const @p@_gap *gap = @p@_gaps + g;
        const int r = gap->known, count = gap->elements * gap->modes;
        for (int j = 0; j < r; j++)
            for (int i = 0; i < r; i++)
                C[j * r + i] = N[gap->known_states[j] * STATES + gap->known_states[i]];
        for (int q = 0; r > 0 && q < gap->columns; q++) {
            for (int j = 0; j < r; j++) {
                const int state = gap->known_states[j];
                const int before = gap->joined ? @p@_ground_place(gap - 1, (gap - 1)->elements * (gap - 1)->modes - 1, q, state) : -1;
                tail[j] = parts[gap->entering + q * STATES + state] + (before < 0 ? K(0.0) : y[before]);
            }
            @p@_collocate(gap, r, C, K(1.0) / parts[@P@_GAIN + g], tail, values);
            for (int k = 0; k < count; k++)
                for (int j = 0; j < r; j++)
                    y[gap->known_first + (k * gap->columns + q) * r + j] = values[k * r + j];
        }
    }
}

/* Modes of one element from the values at its nodes. */
static void store(const @p@_gap *gap, int element, const R *nodes, R *y)
{
    const int M = gap->modes, block = STATES * gap->columns;
    for (int j = 0; j < M; j++)
        for (int q = 0; q < gap->columns; q++)
            for (int state = 0; state < STATES; state++) {
                const int place = @p@_ground_place(gap, element * M + j, q, state);
                R sum = K(0.0);
                for (int m = 0; m < M; m++)
                    sum += gap->from_nodes[j * M + m] * nodes[m * block + q * STATES + state];
                if (place >= 0)
                    y[place] = sum;
            }
}

/* G = exp(N theta / V) (inflow), node by node. */
void @p@_travelled(R t, R s, R V, const R *p, R *y)
{
    R parts[@P@_PARTS], dy[SIZE], N[STATES * STATES], leaving[STATES * COLUMNS], nodes[STATES * COLUMNS * @most_modes@];
    @p@_held_rate_parts(t, s, V, y, p, dy, parts);
    gain_matrix(parts, N);
    for (int g = 0; g < @P@_GAPS; g++) {
        const @p@_gap *gap = @p@_gaps + g;
        const int block = STATES * gap->columns;
        const R time = K(1.0) / parts[@P@_GAIN + g];
        for (int i = 0; i < block; i++)
            leaving[i] = (gap->joined ? leaving[i] : K(0.0)) + parts[gap->entering + i];
        for (int e = 0; e < gap->elements; e++) {
            for (int j = 0; j < gap->modes; j++) {
                @p@_carry(STATES, N, time * (gap->places[j] - (j > 0 ? gap->places[j - 1] : K(0.0))), gap->columns, leaving);
                for (int i = 0; i < block; i++)
                    nodes[j * block + i] = leaving[i];
            }
            store(gap, e, nodes, y);
        }
    }
}

static int inflow_joins(const @p@_gap *gap, int element)
{
    return element > 0 || gap->joined;
}

/* slope / (V/h) for all modes of a gap. */
static void differentiate(const @p@_gap *gap, const R *restrict y, const R *restrict entering, R *restrict slope)
{
    const int block = ROWS * gap->columns, last = gap->modes - 1;
    R halves[2][ROWS * COLUMNS], sum[ROWS * COLUMNS];
    for (int e = 0; e < gap->elements; e++) {
        const int start = gap->first + e * gap->modes * block;
        const R *a = y + start;
        for (int i = 0; i < block; i++) {
            const R before = inflow_joins(gap, e) ? y[start - block + i] : K(0.0);
            const R in = e > 0 ? before : before + entering[i / ROWS * STATES + i % ROWS];
            halves[0][i] = (a[last * block + i] - in) / K(2.0);
            halves[1][i] = (a[last * block + i] + in) / K(2.0);
            sum[i] = K(0.0);
        }
        for (int m = 0; m < last; m++) {
            R *restrict half = halves[m % 2], *restrict next = halves[(m + 1) % 2], *restrict into = slope + start + m * block;
            const R weight = (R)(2 * (2 * m + 1));
            for (int i = 0; i < block; i++) {
                into[i] = weight * half[i];
                sum[i] += into[i];
                next[i] -= a[m * block + i];
            }
        }
        for (int i = 0; i < block; i++)
            slope[start + last * block + i] = sum[i] + (R)(2 * (2 * last + 1)) * halves[last % 2][i];
    }
}

/* x becomes N v - speed x for every vector of a gap. */
static void transport(const @p@_gap *gap, const R *restrict N, R speed, const R *restrict v, R *restrict x)
{
    const int vectors = gap->elements * gap->modes * gap->columns;
    for (int k = 0; k < vectors; k++) {
        const R *carried = v + gap->first + k * ROWS, *known = v + gap->known_first + k * gap->known;
        R all[STATES] = {K(0.0)}, product[ROWS] = {K(0.0)}, *into = x + gap->first + k * ROWS;
        for (int i = 0; i < ROWS; i++)
            all[i] = carried[i];
        for (int j = 0; j < gap->known; j++)
            all[gap->known_states[j]] = known[j];
        for (int m = 0; m < MOVING; m++)
            product[gain_row[moving[m]]] += N[moving[m]] * all[gain_column[moving[m]]];
        for (int i = 0; i < ROWS; i++)
            into[i] = product[i] - speed * into[i];
    }
}

static void rate_of_ground(const R *restrict y, const R *restrict parts, R *restrict dy)
{
    for (int g = 0; g < @P@_GAPS; g++) {
        differentiate(@p@_gaps + g, y, parts + @p@_gaps[g].entering, dy);
        transport(@p@_gaps + g, parts, parts[@P@_GAIN + g], y, dy);
    }
    for (int i = ACTIVE; i < SIZE; i++)
        dy[i] = K(0.0);
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

/* Entries that do not come from the parts' own derivatives: N, and the transport from mode to mode. */
static void add_transport(const @p@_gap *gap, const R *restrict N, R speed, R *restrict values)
{
    const int block = ROWS * gap->columns, width = gap->modes + 1;
    for (int e = 0; e < gap->elements; e++)
        for (int j = 0; j < gap->modes; j++) {
            const int start = gap->first + (e * gap->modes + j) * block;
            for (int q = 0; q < gap->columns; q++)
                for (int m = 0; m < MOVING; m++) {
                    const int k = moving[m];
                    const int place = @p@_ground_place(gap, e * gap->modes + j, q, gain_column[k]);
                    if (place >= 0)
                        add(values, start + q * ROWS + gain_row[k], place, N[k]);
                }
            for (int m = inflow_joins(gap, e) ? -1 : 0; m < gap->modes; m++) {
                const R weight = gap->derivative[j * width + m + 1];
                for (int i = 0; weight != K(0.0) && i < block; i++)
                    add(values, start + i, start + (m - j) * block + i, -speed * weight);
            }
        }
}

/* What one derivative of one part, d parts[part] / d y[column] = x, brings to the rates of a gap. */
static void add_part(int g, int part, int column, R x, const R *restrict y, const R *restrict slope, R speed,
                     R *restrict values)
{
    const @p@_gap *gap = @p@_gaps + g;
    const int count = gap->elements * gap->modes, block = ROWS * gap->columns, entry = part - gap->entering;
    if (part < @P@_GAIN) {
        for (int k = 0; gain_row[part] < ROWS && k < count; k++)
            for (int q = 0; q < gap->columns; q++) {
                const int place = @p@_ground_place(gap, k, q, gain_column[part]);
                if (place >= 0)
                    add(values, gap->first + k * block + q * ROWS + gain_row[part], column, x * y[place]);
            }
    } else if (part == @P@_GAIN + g) {
        for (int i = gap->first; i < gap->first + count * block; i++)
            add(values, i, column, -x * slope[i]);
    } else if (entry >= 0 && entry < STATES * gap->columns && entry % STATES < ROWS) {
        for (int j = 0; j < gap->modes; j++)
            add(values, gap->first + j * block + entry / STATES * ROWS + entry % STATES, column,
                -speed * gap->derivative[j * (gap->modes + 1)] * x);
    }
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
        const int block = ROWS * gap->columns;
        differentiate(gap, y, parts + gap->entering, slope);
        transport(gap, change, change[@P@_GAIN + g], y, slope);
        for (int j = 0; j < gap->modes; j++)
            for (int i = 0; i < block; i++)
                slope[gap->first + j * block + i] -= parts[@P@_GAIN + g] * gap->derivative[j * (gap->modes + 1)]
                                                     * change[gap->entering + i / ROWS * STATES + i % ROWS];
    }
    for (int i = ACTIVE; i < SIZE; i++)
        slope[i] = K(0.0);
}
