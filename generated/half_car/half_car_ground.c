/* The correlation G of the states with the ground between wheels on one track, node by node:
 *
 *     G_j' = N G_j - (V/h) (sum_i D_ji G_i + D_j0 G_in)
 *
 * N, V/h and what the wheels add to the inflow are `parts`, which the model's own equations give. */
#include "half_car_ground.h"

enum { SIZE = HALF_CAR_SIZE, STATES = HALF_CAR_STATES, HEAD = HALF_CAR_HEAD };

void half_car_rate_parts(R t, const R *restrict y, const R *restrict p, R *restrict dy, R *restrict parts);
void half_car_jacobian_parts(R t, const R *restrict y, const R *restrict p, R *restrict values, R *restrict parts);
void half_car_slope_parts(R t, const R *restrict y, const R *restrict p, R *restrict slope, R *restrict parts);
void half_car_held_rate_parts(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict dy, R *restrict parts);
void half_car_held_jacobian_parts(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict values, R *restrict parts);

static const R places_8[8] = {
    K(0.0224793864387125), K(0.11467905316090421), K(0.2657898227845896), K(0.4528463736694444),
    K(0.6473752828868303), K(0.8197593082631076), K(0.9437374394630779), K(1.0)
};
static const R derivative_8[72] = {
    K(-27.874257744139793), K(22.242599964335913), K(7.090311673892603), K(-2.0807353791506724),
    K(0.957335750459313), K(-0.5407289808993251), K(0.3384923324201444), K(-0.2131433200018204),
    K(0.08012570308363978), K(8.358127441196483), K(-16.591130197062405), K(4.359994142072832), K(5.12492476602843),
    K(-1.863703897897215), K(0.9703156119145755), K(-0.5854993702775398), K(0.362304083776957),
    K(-0.13533257975211846), K(-4.656631031707042), K(8.11823601782269), K(-8.545188959239638), K(1.88118564797427),
    K(4.350635666704752), K(-1.7491131793870789), K(0.9622684139381896), K(-0.5721096798557667),
    K(0.21071710374962396), K(3.358409449129932), K(-5.639723637389975), K(4.692019558247469), K(-6.56903294216824),
    K(1.1041272031141063), K(4.215993576843221), K(-1.7852268638042121), K(0.9708780178916394),
    K(-0.3474443618639403), K(-2.8644703520324466), K(4.7359270907952915), K(-3.631848592579313),
    K(3.926435356575788), K(-6.268039956795009), K(0.7723495369955389), K(4.633138954070062),
    K(-1.9608436116902341), K(0.6573515746603227), K(2.8323162584533224), K(-4.647608208611459),
    K(3.435551489028799), K(-3.386351875104237), K(4.160835466074832), K(-7.2632440822916), K(0.6099351296899527),
    K(5.868786019458077), K(-1.6102201966976875), K(-3.381298850276828), K(5.5279700241316805),
    K(-4.015656325439555), K(3.8030184071858204), K(-4.2743007394170744), K(5.806461483798834),
    K(-11.085659975292156), K(0.5298083758173844), K(7.089657599491895), K(8.000000000000002),
    K(-13.06099604193058), K(9.427491723502559), K(-8.803581949472239), K(9.613824007769761),
    K(-12.234234226309487), K(19.116528975794527), K(-44.55903248935455), K(32.50000000000001)
};
const half_car_gap half_car_gaps[] = {
    {90, 1, 2, 8, 0, 41, derivative_8, places_8}
};
static const int gain_row[40] = {
    4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 4, 5, 7, 0, 4, 5, 6, 7, 1, 4, 5, 6, 7, 2, 4, 5, 6, 3, 4, 5, 7, 6, 9, 8, 9, 7,
    11, 10, 11
};
static const int gain_column[40] = {
    0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7, 8, 8, 9, 9, 10,
    10, 11, 11
};
static const int own_column[283] = {
    0, 4, 8, 11, 14, 19, 24, 28, 32, 34, 36, 38, 40, 44, 52, 59, 66, 75, 84, 92, 100, 106, 112, 118, 124, 128, 135,
    142, 151, 160, 168, 176, 182, 188, 194, 200, 203, 209, 217, 225, 232, 239, 244, 249, 254, 259, 262, 270, 278,
    285, 292, 297, 302, 307, 312, 317, 326, 334, 342, 349, 355, 362, 368, 373, 381, 389, 396, 402, 409, 415, 419,
    426, 432, 437, 443, 448, 452, 458, 463, 469, 474, 476, 480, 484, 488, 490, 494, 497, 499, 503, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505, 505,
    505, 505, 506, 507, 508, 509, 510, 511, 512, 513, 514, 515, 516, 517
};
static const int part_row[1] = {
    0
};
static const int part_column[1] = {
    0
};

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
void half_car_carry(int r, const R *C, R d, int columns, R *x)
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
    half_car_decompose(r, even, pivots);
    for (int j = 0; j < r; j++)
        half_car_solve(r, even, pivots, power + j * r);
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
void half_car_travelled(R t, R s, R V, const R *p, R *y)
{
    R parts[HALF_CAR_PARTS], dy[SIZE], N[STATES * STATES];
    half_car_held_rate_parts(t, s, V, y, p, dy, parts);
    for (int i = 0; i < STATES * STATES; i++)
        N[i] = K(0.0);
    for (int k = 0; k < HALF_CAR_GAIN; k++)
        N[gain_column[k] * STATES + gain_row[k]] = parts[k];
    for (int g = 0; g < HALF_CAR_GAPS; g++) {
        const half_car_gap *gap = half_car_gaps + g;
        const int block = STATES * gap->columns;
        const R time = K(1.0) / parts[HALF_CAR_GAIN + g];
        for (int k = 0; k < gap->elements * gap->nodes; k++) {
            const int node = k % gap->nodes;
            R *G = y + gap->first + k * block;
            for (int i = 0; i < block; i++)
                G[i] = (k > 0 || gap->joined ? G[i - block] : K(0.0)) + (k > 0 ? K(0.0) : parts[gap->entering + i]);
            half_car_carry(STATES, N, time * (gap->places[node] - (node > 0 ? gap->places[node - 1] : K(0.0))),
                      gap->columns, G);
        }
    }
}

static int inflow_joins(const half_car_gap *gap, int element)
{
    return element > 0 || gap->joined;
}

/* sum_i D_ji G_i + D_j0 G_in for all nodes of a gap. */
static void differentiate(const half_car_gap *gap, const R *restrict y, const R *restrict entering, R *restrict slope)
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
static void transport(const half_car_gap *gap, const R *restrict N, R speed, const R *restrict v, R *restrict x)
{
    const int end = gap->first + gap->elements * gap->nodes * gap->columns * STATES;
    for (int start = gap->first; start < end; start += STATES) {
        R product[STATES] = {K(0.0)};
        for (int k = 0; k < HALF_CAR_GAIN; k++)
            product[gain_row[k]] += N[k] * v[start + gain_column[k]];
        for (int i = 0; i < STATES; i++)
            x[start + i] = product[i] - speed * x[start + i];
    }
}

static void rate_of_ground(const R *restrict y, const R *restrict parts, R *restrict dy)
{
    for (int g = 0; g < HALF_CAR_GAPS; g++) {
        differentiate(half_car_gaps + g, y, parts + half_car_gaps[g].entering, dy);
        transport(half_car_gaps + g, parts, parts[HALF_CAR_GAIN + g], y, dy);
    }
}

/* Place an entry of the Jacobian; its rows are in order. */
static void add(R *values, int row, int column, R x)
{
    int low = half_car_jacobian_column[column], high = half_car_jacobian_column[column + 1] - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (half_car_jacobian_row[middle] < row)
            low = middle + 1;
        else
            high = middle;
    }
    values[low] += x;
}

/* Entries that do not come from the parts' own derivatives: N, and the transport from node to node. */
static void add_transport(const half_car_gap *gap, const R *restrict N, R speed, R *restrict values)
{
    const int block = STATES * gap->columns, width = gap->nodes + 1;
    for (int e = 0; e < gap->elements; e++)
        for (int j = 0; j < gap->nodes; j++) {
            const int start = gap->first + (e * gap->nodes + j) * block;
            for (int q = 0; q < gap->columns; q++)
                for (int k = 0; k < HALF_CAR_GAIN; k++)
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
    const half_car_gap *gap = half_car_gaps + g;
    const int block = STATES * gap->columns, end = gap->first + gap->elements * gap->nodes * block;
    if (part < HALF_CAR_GAIN)
        for (int start = gap->first; start < end; start += STATES)
            add(values, start + gain_row[part], column, x * y[start + gain_column[part]]);
    else if (part == HALF_CAR_GAIN + g)
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
    for (int k = 0; k < HALF_CAR_NONZEROS; k++)
        values[k] = K(0.0);
    for (int j = 0; j < SIZE; j++)
        for (int k = own_column[j]; k < own_column[j + 1]; k++)
            values[half_car_jacobian_column[j] + k - own_column[j]] = own[k];
    for (int g = 0; g < HALF_CAR_GAPS; g++) {
        const R speed = parts[HALF_CAR_GAIN + g];
        differentiate(half_car_gaps + g, y, parts + half_car_gaps[g].entering, slope);
        add_transport(half_car_gaps + g, parts, speed, values);
        for (int k = 0; k < 0; k++)
            add_part(g, part_row[k], part_column[k], of_parts[k], y, slope, speed, values);
    }
}

void half_car_rate(R t, const R *restrict y, const R *restrict p, R *restrict dy)
{
    R parts[HALF_CAR_PARTS];
    half_car_rate_parts(t, y, p, dy, parts);
    rate_of_ground(y, parts, dy);
}

void half_car_held_rate(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict dy)
{
    R parts[HALF_CAR_PARTS];
    half_car_held_rate_parts(t, s, V, y, p, dy, parts);
    rate_of_ground(y, parts, dy);
}

void half_car_jacobian(R t, const R *restrict y, const R *restrict p, R *restrict values)
{
    R parts[HALF_CAR_PARTS], dy[SIZE], own[517], of_parts[0 > 0 ? 0 : 1];
    half_car_rate_parts(t, y, p, dy, parts);
    half_car_jacobian_parts(t, y, p, own, of_parts);
    jacobian_of_ground(y, parts, own, of_parts, values);
}

void half_car_held_jacobian(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict values)
{
    R parts[HALF_CAR_PARTS], dy[SIZE], own[517], of_parts[0 > 0 ? 0 : 1];
    half_car_held_rate_parts(t, s, V, y, p, dy, parts);
    half_car_held_jacobian_parts(t, s, V, y, p, own, of_parts);
    jacobian_of_ground(y, parts, own, of_parts, values);
}

void half_car_slope(R t, const R *restrict y, const R *restrict p, R *restrict slope)
{
    R parts[HALF_CAR_PARTS], change[HALF_CAR_PARTS], dy[SIZE];
    half_car_rate_parts(t, y, p, dy, parts);
    half_car_slope_parts(t, y, p, slope, change);
    for (int g = 0; g < HALF_CAR_GAPS; g++) {
        const half_car_gap *gap = half_car_gaps + g;
        const int block = STATES * gap->columns;
        differentiate(gap, y, parts + gap->entering, slope);
        transport(gap, change, change[HALF_CAR_GAIN + g], y, slope);
        for (int j = 0; j < gap->nodes; j++)
            for (int i = 0; i < block; i++)
                slope[gap->first + j * block + i] -=
                    parts[HALF_CAR_GAIN + g] * gap->derivative[j * (gap->nodes + 1)] * change[gap->entering + i];
    }
}
