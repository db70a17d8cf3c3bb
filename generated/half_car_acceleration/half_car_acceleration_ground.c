/* The correlation G of the states with the ground between wheels on one track, element by element:
 *
 *     a_i' = N a_i - slope_i,    slope_i = (V/h) (2 i + 1) (out - (-1)^i in - 2 (a_(i-1) + a_(i-3) + ...))
 *
 * with `out` for the last of these, whose slope is the sum of all. N, V/h and what the wheels add to the inflow are
 * `parts`, which the model's own equations give. */
#include "half_car_acceleration_ground.h"

enum { SIZE = HALF_CAR_ACCELERATION_SIZE, STATES = HALF_CAR_ACCELERATION_STATES, ACTIVE = HALF_CAR_ACCELERATION_ACTIVE, ROWS = HALF_CAR_ACCELERATION_ROWS, COLUMNS = 1, MOVING = 34 };

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
    K(-1.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(1.0), K(3.0), K(-6.0),
    K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(3.0), K(-5.0), K(0.0), K(-10.0), K(0.0),
    K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(5.0), K(7.0), K(-14.0), K(0.0), K(-14.0), K(0.0), K(0.0),
    K(0.0), K(0.0), K(0.0), K(0.0), K(7.0), K(-9.0), K(0.0), K(-18.0), K(0.0), K(-18.0), K(0.0), K(0.0), K(0.0),
    K(0.0), K(0.0), K(9.0), K(11.0), K(-22.0), K(0.0), K(-22.0), K(0.0), K(-22.0), K(0.0), K(0.0), K(0.0), K(0.0),
    K(11.0), K(-13.0), K(0.0), K(-26.0), K(0.0), K(-26.0), K(0.0), K(-26.0), K(0.0), K(0.0), K(0.0), K(13.0),
    K(15.0), K(-30.0), K(0.0), K(-30.0), K(0.0), K(-30.0), K(0.0), K(-30.0), K(0.0), K(0.0), K(15.0), K(-17.0),
    K(0.0), K(-34.0), K(0.0), K(-34.0), K(0.0), K(-34.0), K(0.0), K(-34.0), K(0.0), K(17.0), K(10.0), K(-110.0),
    K(-88.0), K(-104.0), K(-78.0), K(-90.0), K(-60.0), K(-68.0), K(-34.0), K(-38.0), K(100.0)
};
static const R from_nodes_10[100] = {
    K(0.036808502743379226), K(0.08218800636846074), K(0.11959671585718977), K(0.14530508241645945),
    K(0.1567912286134691), K(0.15292964386221128), K(0.13409741892058927), K(0.10213506593950034),
    K(0.06014833527874068), K(0.010000000000000132), K(-0.10724251290954107), K(-0.20988151155046722),
    K(-0.2324123054625044), K(-0.16593760791083273), K(-0.035776245229114184), K(0.10838175981564308),
    K(0.2114633278154442), K(0.23404517210978834), K(0.1673599233215837), K(0.03000000000000022),
    K(0.16835691027626867), K(0.2411710739927173), K(0.07738058356734204), K(-0.20534617356771043),
    K(-0.38517529024922026), K(-0.31831534085136115), K(-0.05735640021388621), K(0.19159619085845397),
    K(0.2376884461873957), K(0.05000000000000045), K(-0.21468776969188855), K(-0.1525297502330997),
    K(0.24457293622370954), K(0.44051732731075594), K(0.12400955876425467), K(-0.34405364510689185),
    K(-0.399291003919988), K(-0.02258874098750561), K(0.25405108764065326), K(0.07000000000000034),
    K(0.24184189655847235), K(-0.033447316743455045), K(-0.4609227395986754), K(-0.10008394614248313),
    K(0.4987644898177824), K(0.24685171698845865), K(-0.3948117548505618), K(-0.2974768752749954),
    K(0.20928452924545698), K(0.09000000000000033), K(-0.24682266851731818), K(0.25438832506750814),
    K(0.34939175204352924), K(-0.4699766448857399), K(-0.23935611043025898), K(0.5608173280581252),
    K(0.04539712380200018), K(-0.4714984823778083), K(0.10765937723996222), K(0.11000000000000021),
    K(0.22826145441572637), K(-0.4289131502147325), K(0.0644450099454954), K(0.5080958495135548),
    K(-0.5609199905295084), K(-0.010086827513764869), K(0.5269391437323171), K(-0.4222517716496423),
    K(-0.03556971769944591), K(0.1300000000000002), K(-0.18653852737619778), K(0.4850237628926721),
    K(-0.49783424984139024), K(0.13486429687955895), K(0.3711878634588567), K(-0.6606068937954153),
    K(0.5404744320452965), K(-0.14004142560949892), K(-0.1965292586538812), K(0.14999999999999938),
    K(0.12378459499724256), K(-0.3865613527523305), K(0.6115309781366497), K(-0.6904723587592411),
    K(0.5818283785640116), K(-0.32008184453681354), K(0.0007687776367729735), K(0.2558432212916699),
    K(-0.34664039457796103), K(0.1699999999999995), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0), K(0.0),
    K(0.0), K(1.0)
};
static const int known_0[2] = {
    8, 9
};
const half_car_acceleration_gap half_car_acceleration_gaps[] = {
    {90, 730, 2, 1, 8, 10, 0, 41, known_0, derivative_10, places_10, from_nodes_10}
};
static const int gain_row[40] = {
    4, 5, 6, 7, 4, 5, 6, 7, 4, 5, 6, 4, 5, 7, 0, 4, 5, 6, 7, 1, 4, 5, 6, 7, 2, 4, 5, 6, 3, 4, 5, 7, 6, 9, 8, 9, 7,
    11, 10, 11
};
static const int gain_column[40] = {
    0, 0, 0, 0, 1, 1, 1, 1, 2, 2, 2, 3, 3, 3, 4, 4, 4, 4, 4, 5, 5, 5, 5, 5, 6, 6, 6, 6, 7, 7, 7, 7, 8, 8, 9, 9, 10,
    10, 11, 11
};
static const int moving[34] = {
    0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15, 16, 17, 18, 19, 20, 21, 22, 23, 24, 25, 26, 27, 28, 29,
    30, 31, 32, 36
};
static const int own_column[891] = {
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
    950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 950, 951, 952, 953, 954, 955,
    956, 957, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958,
    958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958,
    958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958,
    958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958,
    958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958,
    958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958,
    958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958, 958,
    958, 958, 958, 958, 958, 958, 958, 959, 960
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

static void gain_matrix(const R *parts, R *N)
{
    for (int i = 0; i < STATES * STATES; i++)
        N[i] = K(0.0);
    for (int k = 0; k < HALF_CAR_ACCELERATION_GAIN; k++)
        N[gain_column[k] * STATES + gain_row[k]] = parts[k];
}

void half_car_acceleration_collocate(const half_car_acceleration_gap *gap, int r, const R *C, R scale, R *tail, R *values)
{
    const int n = r * gap->modes, width = gap->modes + 1;
    R matrix[HALF_CAR_ACCELERATION_COLLOCATED * HALF_CAR_ACCELERATION_COLLOCATED];
    int pivots[HALF_CAR_ACCELERATION_COLLOCATED];
    for (int i = 0; i < n * n; i++)
        matrix[i] = K(0.0);
    for (int j = 0; j < gap->modes; j++)
        for (int i = 0; i < r; i++) {
            for (int m = 0; m < gap->modes; m++)
                matrix[(m * r + i) * n + j * r + i] += gap->derivative[j * width + m + 1];
            for (int k = 0; k < r; k++)
                matrix[(j * r + k) * n + j * r + i] -= scale * C[k * r + i];
        }
    half_car_acceleration_decompose(n, matrix, pivots);
    for (int e = 0; e < gap->elements; e++, values += n) {
        for (int j = 0; j < gap->modes; j++)
            for (int i = 0; i < r; i++)
                values[j * r + i] = -gap->derivative[j * width] * tail[i];
        half_car_acceleration_solve(n, matrix, pivots, values);
        for (int i = 0; i < r; i++)
            tail[i] = values[n - r + i];
    }
}

int half_car_acceleration_ground_place(const half_car_acceleration_gap *gap, int k, int q, int state)
{
    const int vector = k * gap->columns + q;
    if (state < ROWS)
        return gap->first + vector * ROWS + state;
    for (int j = 0; j < gap->known; j++)
        if (gap->known_states[j] == state)
            return gap->known_first + vector * gap->known + j;
    return -1;
}

void half_car_acceleration_know_ground(R t, R s, const R *p, R *y)
{
    R parts[HALF_CAR_ACCELERATION_PARTS], dy[SIZE], N[STATES * STATES], C[STATES * STATES], tail[STATES], values[HALF_CAR_ACCELERATION_LONGEST];
    half_car_acceleration_held_rate_parts(t, s, K(1.0), y, p, dy, parts);
    gain_matrix(parts, N);
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
        const int r = gap->known, count = gap->elements * gap->modes;
        for (int j = 0; j < r; j++)
            for (int i = 0; i < r; i++)
                C[j * r + i] = N[gap->known_states[j] * STATES + gap->known_states[i]];
        for (int q = 0; r > 0 && q < gap->columns; q++) {
            for (int j = 0; j < r; j++) {
                const int state = gap->known_states[j];
                const int before = gap->joined ? half_car_acceleration_ground_place(gap - 1, (gap - 1)->elements * (gap - 1)->modes - 1, q, state) : -1;
                tail[j] = parts[gap->entering + q * STATES + state] + (before < 0 ? K(0.0) : y[before]);
            }
            half_car_acceleration_collocate(gap, r, C, K(1.0) / parts[HALF_CAR_ACCELERATION_GAIN + g], tail, values);
            for (int k = 0; k < count; k++)
                for (int j = 0; j < r; j++)
                    y[gap->known_first + (k * gap->columns + q) * r + j] = values[k * r + j];
        }
    }
}

/* Modes of one element from the values at its nodes. */
static void store(const half_car_acceleration_gap *gap, int element, const R *nodes, R *y)
{
    const int M = gap->modes, block = STATES * gap->columns;
    for (int j = 0; j < M; j++)
        for (int q = 0; q < gap->columns; q++)
            for (int state = 0; state < STATES; state++) {
                const int place = half_car_acceleration_ground_place(gap, element * M + j, q, state);
                R sum = K(0.0);
                for (int m = 0; m < M; m++)
                    sum += gap->from_nodes[j * M + m] * nodes[m * block + q * STATES + state];
                if (place >= 0)
                    y[place] = sum;
            }
}

/* G = exp(N theta / V) (inflow), node by node. */
void half_car_acceleration_travelled(R t, R s, R V, const R *p, R *y)
{
    R parts[HALF_CAR_ACCELERATION_PARTS], dy[SIZE], N[STATES * STATES], leaving[STATES * COLUMNS], nodes[STATES * COLUMNS * 10];
    half_car_acceleration_held_rate_parts(t, s, V, y, p, dy, parts);
    gain_matrix(parts, N);
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
        const int block = STATES * gap->columns;
        const R time = K(1.0) / parts[HALF_CAR_ACCELERATION_GAIN + g];
        for (int i = 0; i < block; i++)
            leaving[i] = (gap->joined ? leaving[i] : K(0.0)) + parts[gap->entering + i];
        for (int e = 0; e < gap->elements; e++) {
            for (int j = 0; j < gap->modes; j++) {
                half_car_acceleration_carry(STATES, N, time * (gap->places[j] - (j > 0 ? gap->places[j - 1] : K(0.0))), gap->columns, leaving);
                for (int i = 0; i < block; i++)
                    nodes[j * block + i] = leaving[i];
            }
            store(gap, e, nodes, y);
        }
    }
}

static int inflow_joins(const half_car_acceleration_gap *gap, int element)
{
    return element > 0 || gap->joined;
}

/* slope / (V/h) for all modes of a gap. */
static void differentiate(const half_car_acceleration_gap *gap, const R *restrict y, const R *restrict entering, R *restrict slope)
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
static void transport(const half_car_acceleration_gap *gap, const R *restrict N, R speed, const R *restrict v, R *restrict x)
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
    for (int g = 0; g < HALF_CAR_ACCELERATION_GAPS; g++) {
        differentiate(half_car_acceleration_gaps + g, y, parts + half_car_acceleration_gaps[g].entering, dy);
        transport(half_car_acceleration_gaps + g, parts, parts[HALF_CAR_ACCELERATION_GAIN + g], y, dy);
    }
    for (int i = ACTIVE; i < SIZE; i++)
        dy[i] = K(0.0);
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

/* Entries that do not come from the parts' own derivatives: N, and the transport from mode to mode. */
static void add_transport(const half_car_acceleration_gap *gap, const R *restrict N, R speed, R *restrict values)
{
    const int block = ROWS * gap->columns, width = gap->modes + 1;
    for (int e = 0; e < gap->elements; e++)
        for (int j = 0; j < gap->modes; j++) {
            const int start = gap->first + (e * gap->modes + j) * block;
            for (int q = 0; q < gap->columns; q++)
                for (int m = 0; m < MOVING; m++) {
                    const int k = moving[m];
                    const int place = half_car_acceleration_ground_place(gap, e * gap->modes + j, q, gain_column[k]);
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
    const half_car_acceleration_gap *gap = half_car_acceleration_gaps + g;
    const int count = gap->elements * gap->modes, block = ROWS * gap->columns, entry = part - gap->entering;
    if (part < HALF_CAR_ACCELERATION_GAIN) {
        for (int k = 0; gain_row[part] < ROWS && k < count; k++)
            for (int q = 0; q < gap->columns; q++) {
                const int place = half_car_acceleration_ground_place(gap, k, q, gain_column[part]);
                if (place >= 0)
                    add(values, gap->first + k * block + q * ROWS + gain_row[part], column, x * y[place]);
            }
    } else if (part == HALF_CAR_ACCELERATION_GAIN + g) {
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
    R parts[HALF_CAR_ACCELERATION_PARTS], dy[SIZE], own[960], of_parts[142 > 0 ? 142 : 1];
    half_car_acceleration_rate_parts(t, y, p, dy, parts);
    half_car_acceleration_jacobian_parts(t, y, p, own, of_parts);
    jacobian_of_ground(y, parts, own, of_parts, values);
}

void half_car_acceleration_held_jacobian(R t, R s, R V, const R *restrict y, const R *restrict p, R *restrict values)
{
    R parts[HALF_CAR_ACCELERATION_PARTS], dy[SIZE], own[960], of_parts[142 > 0 ? 142 : 1];
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
        const int block = ROWS * gap->columns;
        differentiate(gap, y, parts + gap->entering, slope);
        transport(gap, change, change[HALF_CAR_ACCELERATION_GAIN + g], y, slope);
        for (int j = 0; j < gap->modes; j++)
            for (int i = 0; i < block; i++)
                slope[gap->first + j * block + i] -= parts[HALF_CAR_ACCELERATION_GAIN + g] * gap->derivative[j * (gap->modes + 1)]
                                                     * change[gap->entering + i / ROWS * STATES + i % ROWS];
    }
    for (int i = ACTIVE; i < SIZE; i++)
        slope[i] = K(0.0);
}
