/* The correlation G of the states with the ground between wheels on one track, node by node:
 *
 *     G_j' = N G_j - (V/h) (sum_i D_ji G_i + D_j0 G_in)
 *
 * N, V/h and what the wheels add to the inflow are `parts`, which the model's own equations give. */
#include "half_car_acceleration_ground.h"

enum { SIZE = HALF_CAR_ACCELERATION_SIZE, STATES = HALF_CAR_ACCELERATION_STATES, HEAD = HALF_CAR_ACCELERATION_HEAD };

void half_car_acceleration_rate_parts(R t, const R *restrict y, const R *restrict p, R *restrict dy, R *restrict parts);
void half_car_acceleration_jacobian_parts(R t, const R *restrict y, const R *restrict p, R *restrict values, R *restrict parts);
void half_car_acceleration_slope_parts(R t, const R *restrict y, const R *restrict p, R *restrict slope, R *restrict parts);
void half_car_acceleration_held_rate_parts(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict dy, R *restrict parts);
void half_car_acceleration_held_jacobian_parts(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict values, R *restrict parts);

static const R places_10[10] = {
    K(0.014412409648876467), K(0.07438738970919595), K(0.17611665616299516), K(0.30966757992763777),
    K(0.46197040108101106), K(0.6181172346952941), K(0.7628230151850396), K(0.8819210212100013),
    K(0.9637421871167904), K(1.0)
};
static const R derivative_10[110] = {
    K(-43.416781419332466), K(34.69232502969973), K(10.966768447404252), K(-3.188836183009444),
    K(1.4517413398175565), K(-0.8145142991784907), K(0.5155609176231513), K(-0.3505521258992888),
    K(0.24546694513997727), K(-0.16466772675993352), K(0.0634890744949635), K(12.789280640125877),
    K(-25.350183165319287), K(6.721569367532053), K(7.706531098214244), K(-2.7698267590574672),
    K(1.4299949714404976), K(-0.8703074015371196), K(0.5794025682728619), K(-0.40091971023088807),
    K(0.2672401798845072), K(-0.10278178932527873), K(-6.890332145909656), K(11.99292010956669),
    K(-12.538605513097759), K(2.8390273293472914), K(6.224238487748906), K(-2.4731502897232023),
    K(1.3656146364570547), K(-0.8671976827650038), K(0.5850983026206057), K(-0.3849037780418735),
    K(0.14729054379694628), K(4.714240422200553), K(-7.9016125993896225), K(6.521938033243851),
    K(-9.007825876421949), K(1.614634635362342), K(5.584101783622718), K(-2.354147070769833), K(1.3506990350349128),
    K(-0.868143752130542), K(0.557585599872597), K(-0.2114702106250274), K(-3.7156264262032392),
    K(6.129183937466353), K(-4.655175133485002), K(4.948364915014119), K(-7.7202395871934435),
    K(1.0823204231916015), K(5.467936015419136), K(-2.3921627303731383), K(1.3909789457346853),
    K(-0.8546166047570452), K(0.31903624518597323), K(3.2525107071504458), K(-5.321949119493562),
    K(3.8865206485252948), K(-3.748229389239107), K(4.4647570524517395), K(-7.500845364517062),
    K(0.8089080386934538), K(5.825081733022479), K(-2.59346954584541), K(1.453168147519665), K(-0.5264529082679373),
    K(-3.126640123466931), K(5.092927906292783), K(-3.6416056270712507), K(3.3499652389630237),
    K(-3.6053466137117534), K(4.6185080115689), K(-8.198345497512904), K(0.6554600346958823), K(6.815061567576405),
    K(-2.965593872523005), K(1.005608975188851), K(3.331944171569953), K(-5.413266308232657), K(3.824911184447339),
    K(-3.4308559345356873), K(3.5174791346388097), K(-4.076458165512641), K(5.540599998596214),
    K(-10.344779438027693), K(0.5669441911181385), K(8.97207959092269), K(-2.488598424984466), K(-4.15343825744544),
    K(6.738407993033947), K(-4.730947627818349), K(4.188015258114751), K(-4.192121609856885), K(4.647465747043938),
    K(-5.760682668145269), K(8.353059311037084), K(-16.64851704679335), K(0.5188109503600593),
    K(11.039947950469514), K(10.000000000000117), K(-16.214760957094224), K(11.355997822549725),
    K(-10.002157489653577), K(9.922800569138067), K(-10.827984809824466), K(13.02507861818964),
    K(-17.677700506125216), K(28.820399799973146), K(-68.90167304715304), K(50.49999999999983)
};
const half_car_acceleration_gap half_car_acceleration_gaps[] = {
    {90, 1, 8, 10, 0, 41, derivative_10, places_10}
};
static const int gain_row[40] = {
    4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 4, 5, 7, 0, 4, 5, 6, 7, 1, 4, 5, 6, 7, 2, 4, 5, 6, 3, 4, 5, 7, 6, 9, 8, 9, 7,
    11, 10, 11
};
static const int gain_column[40] = {
    0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7, 8, 8, 9, 9, 10,
    10, 11, 11
};
static const int own_column[1051] = {
    0, 4, 8, 11, 14, 61, 108, 145, 182, 184, 186, 188, 190, 194, 202, 209, 216, 225, 234, 242, 250, 256, 262, 268,
    274, 278, 285, 292, 301, 310, 318, 326, 332, 338, 344, 350, 353, 359, 367, 375, 382, 389, 394, 399, 404, 409,
    412, 420, 428, 435, 442, 447, 452, 457, 462, 508, 554, 590, 626, 633, 639, 646, 652, 698, 734, 770, 777, 783,
    790, 796, 832, 839, 845, 850, 856, 861, 897, 903, 908, 914, 919, 921, 925, 929, 933, 935, 939, 942, 944, 948,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950,
    950, 950, 950, 951, 952, 953, 954, 955, 956, 957, 958, 959, 960, 961, 962
};
static const int part_row[142] = {
    15, 16, 17, 18, 20, 21, 22, 23, 25, 26, 27, 29, 30, 31, 15, 16, 17, 18, 20, 21, 22, 23, 25, 26, 27, 29, 30, 31,
    15, 16, 17, 20, 21, 22, 25, 26, 27, 15, 16, 18, 20, 21, 23, 29, 30, 31, 15, 16, 17, 18, 20, 21, 22, 23, 25, 26,
    27, 29, 30, 31, 15, 16, 17, 18, 20, 21, 22, 23, 25, 26, 27, 29, 30, 31, 15, 16, 17, 20, 21, 22, 25, 26, 27, 15,
    16, 18, 20, 21, 23, 29, 30, 31, 15, 16, 17, 18, 20, 21, 22, 23, 25, 26, 27, 29, 30, 31, 15, 16, 17, 20, 21, 22,
    25, 26, 27, 15, 16, 18, 20, 21, 23, 29, 30, 31, 15, 16, 17, 20, 21, 22, 25, 26, 27, 15, 16, 18, 20, 21, 23, 29,
    30, 31
};
static const int part_column[142] = {
    4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 4, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 5, 6, 6, 6, 6, 6, 6, 6, 6, 6,
    7, 7, 7, 7, 7, 7, 7, 7, 7, 54, 54, 54, 54, 54, 54, 54, 54, 54, 54, 54, 54, 54, 54, 55, 55, 55, 55, 55, 55, 55,
    55, 55, 55, 55, 55, 55, 55, 56, 56, 56, 56, 56, 56, 56, 56, 56, 57, 57, 57, 57, 57, 57, 57, 57, 57, 62, 62, 62,
    62, 62, 62, 62, 62, 62, 62, 62, 62, 62, 62, 63, 63, 63, 63, 63, 63, 63, 63, 63, 64, 64, 64, 64, 64, 64, 64, 64,
    64, 69, 69, 69, 69, 69, 69, 69, 69, 69, 75, 75, 75, 75, 75, 75, 75, 75, 75
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
void half_car_acceleration_carry(int r, const R *C, R d, int columns, R *x)
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
    half_car_acceleration_decompose(r, even, pivots);
    for (int j = 0; j < r; j++)
        half_car_acceleration_solve(r, even, pivots, power + j * r);
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
void half_car_acceleration_travelled(R t, R s, R V, const R *p, R *y)
{
    R parts[HALF_CAR_ACCELERATION_PARTS], dy[SIZE], N[STATES * STATES];
    half_car_acceleration_held_rate_parts(t, s, V, y, p, dy, parts);
    for (int i = 0; i < STATES * STATES; i++)
        N[i] = K(0.0);
    for (int k = 0; k < HALF_CAR_ACCELERATION_GAIN; k++)
        N[gain_column[k] * STATES + gain_row[k]] = parts[k];
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
        const int block = STATES * gap->columns;
        const R time = K(1.0) / parts[HALF_CAR_ACCELERATION_GAIN + g];
        for (int k = 0; k < gap->elements * gap->nodes; k++) {
            const int node = k % gap->nodes;
            R *G = y + gap->first + k * block;
            for (int i = 0; i < block; i++)
                G[i] = (k > 0 || gap->joined ? G[i - block] : K(0.0)) + (k > 0 ? K(0.0) : parts[gap->entering + i]);
            half_car_acceleration_carry(STATES, N, time * (gap->places[node] - (node > 0 ? gap->places[node - 1] : K(0.0))),
                      gap->columns, G);
        }
    }
}

static int inflow_joins(const half_car_acceleration_gap *gap, int element)
{
    return element > 0 || gap->joined;
}

/* sum_i D_ji G_i + D_j0 G_in for all nodes of a gap. */
static void differentiate(const half_car_acceleration_gap *gap, const R *restrict y, const R *restrict entering, R *restrict slope)
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
static void transport(const half_car_acceleration_gap *gap, const R *restrict N, R speed, const R *restrict v, R *restrict x)
{
    const int end = gap->first + gap->elements * gap->nodes * gap->columns * STATES;
    for (int start = gap->first; start < end; start += STATES) {
        R product[STATES] = {K(0.0)};
        for (int k = 0; k < HALF_CAR_ACCELERATION_GAIN; k++)
            product[gain_row[k]] += N[k] * v[start + gain_column[k]];
        for (int i = 0; i < STATES; i++)
            x[start + i] = product[i] - speed * x[start + i];
    }
}

static void rate_of_ground(const R *restrict y, const R *restrict parts, R *restrict dy)
{
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        differentiate(half_car_acceleration_gaps + g, y, parts + half_car_acceleration_gaps[g].entering, dy);
        transport(half_car_acceleration_gaps + g, parts, parts[HALF_CAR_ACCELERATION_GAIN + g], y, dy);
    }
}

/* Place an entry of the Jacobian; its rows are in order. */
static void add(R *values, int row, int column, R x)
{
    int low = half_car_acceleration_jacobian_column[column], high = half_car_acceleration_jacobian_column[column + 1] - 1;
    while (low < high) {
        const int middle = (low + high) / 2;
        if (half_car_acceleration_jacobian_row[middle] < row)
            low = middle + 1;
        else
            high = middle;
    }
    values[low] += x;
}

/* Entries that do not come from the parts' own derivatives: N, and the transport from node to node. */
static void add_transport(const half_car_acceleration_gap *gap, const R *restrict N, R speed, R *restrict values)
{
    const int block = STATES * gap->columns, width = gap->nodes + 1;
    for (int e = 0; e < gap->elements; e++)
        for (int j = 0; j < gap->nodes; j++) {
            const int start = gap->first + (e * gap->nodes + j) * block;
            for (int q = 0; q < gap->columns; q++)
                for (int k = 0; k < HALF_CAR_ACCELERATION_GAIN; k++)
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
    const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
    const int block = STATES * gap->columns, end = gap->first + gap->elements * gap->nodes * block;
    if (part < HALF_CAR_ACCELERATION_GAIN)
        for (int start = gap->first; start < end; start += STATES)
            add(values, start + gain_row[part], column, x * y[start + gain_column[part]]);
    else if (part == HALF_CAR_ACCELERATION_GAIN + g)
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
    for (int k = 0; k < HALF_CAR_ACCELERATION_NONZEROS; k++)
        values[k] = K(0.0);
    for (int j = 0; j < SIZE; j++)
        for (int k = own_column[j]; k < own_column[j + 1]; k++)
            values[half_car_acceleration_jacobian_column[j] + k - own_column[j]] = own[k];
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        const R speed = parts[HALF_CAR_ACCELERATION_GAIN + g];
        differentiate(half_car_acceleration_gaps + g, y, parts + half_car_acceleration_gaps[g].entering, slope);
        add_transport(half_car_acceleration_gaps + g, parts, speed, values);
        for (int k = 0; k < 142; k++)
            add_part(g, part_row[k], part_column[k], of_parts[k], y, slope, speed, values);
    }
}

void half_car_acceleration_rate(R t, const R *restrict y, const R *restrict p, R *restrict dy)
{
    R parts[HALF_CAR_ACCELERATION_PARTS];
    half_car_acceleration_rate_parts(t, y, p, dy, parts);
    rate_of_ground(y, parts, dy);
}

void half_car_acceleration_held_rate(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict dy)
{
    R parts[HALF_CAR_ACCELERATION_PARTS];
    half_car_acceleration_held_rate_parts(t, s, V, y, p, dy, parts);
    rate_of_ground(y, parts, dy);
}

void half_car_acceleration_jacobian(R t, const R *restrict y, const R *restrict p, R *restrict values)
{
    R parts[HALF_CAR_ACCELERATION_PARTS], dy[SIZE], own[962], of_parts[142 > 0 ? 142 : 1];
    half_car_acceleration_rate_parts(t, y, p, dy, parts);
    half_car_acceleration_jacobian_parts(t, y, p, own, of_parts);
    jacobian_of_ground(y, parts, own, of_parts, values);
}

void half_car_acceleration_held_jacobian(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict values)
{
    R parts[HALF_CAR_ACCELERATION_PARTS], dy[SIZE], own[962], of_parts[142 > 0 ? 142 : 1];
    half_car_acceleration_held_rate_parts(t, s, V, y, p, dy, parts);
    half_car_acceleration_held_jacobian_parts(t, s, V, y, p, own, of_parts);
    jacobian_of_ground(y, parts, own, of_parts, values);
}

void half_car_acceleration_slope(R t, const R *restrict y, const R *restrict p, R *restrict slope)
{
    R parts[HALF_CAR_ACCELERATION_PARTS], change[HALF_CAR_ACCELERATION_PARTS], dy[SIZE];
    half_car_acceleration_rate_parts(t, y, p, dy, parts);
    half_car_acceleration_slope_parts(t, y, p, slope, change);
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
        const int block = STATES * gap->columns;
        differentiate(gap, y, parts + gap->entering, slope);
        transport(gap, change, change[HALF_CAR_ACCELERATION_GAIN + g], y, slope);
        for (int j = 0; j < gap->nodes; j++)
            for (int i = 0; i < block; i++)
                slope[gap->first + j * block + i] -=
                    parts[HALF_CAR_ACCELERATION_GAIN + g] * gap->derivative[j * (gap->nodes + 1)] * change[gap->entering + i];
    }
}
